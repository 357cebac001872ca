"""Comparing correctors: all methods on the same frames, judged by the truth or by held-out pixels.

`sources` gives frames with what they are judged by, `methods` what is compared, `judging` runs one method on one
sequence to a `cell`, `suite` runs them all and keeps what is done, `results` makes the tidy table, and `report` the
page for people.
"""
