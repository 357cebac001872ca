"""Compares correctors on the same frames, by the truth, by pixels that are held out, or by later frames.

`suite` runs all `methods` on the frames of all `sources`: `running` times one of them, `scoring` sums its errors by the
pixel `groups`, and `result_cache` keeps its `measurements`. The `kinds` of pixels of a real recording have
`references`, those of its holes perhaps from `later_frames`; `intervals` says how far results may be chance. `report`
and `figures` show the numbers that `quantities` lists.
"""
