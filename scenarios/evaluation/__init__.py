"""Comparing correctors: all methods on the same frames, judged by the truth or by held-out pixels.

`sources` gives frames with what they are judged by, `methods` what is compared, `judging` runs one method on one
sequence, which `scoring` makes the figures of a `cell` of. `suite` runs them all, and the `shelf` keeps what is done.
`results` makes the tidy table of all figures, `quantities` say what tables are about, `page` has them.
"""
