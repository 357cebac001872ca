"""Compares correctors on the same frames, by the truth, by pixels that are held out, or by later frames.

`suite` runs all `methods` on the `frames` of all sequences: `recordings` reads those of real sensors with their
`references`, those of holes perhaps from `later_frames`; `scoring` sums the errors of a method by masks and range, and
`record` keeps its `measurements`. `bootstrap` says how far results may be chance. `report` shows the numbers that
`quantities` lists.
"""
