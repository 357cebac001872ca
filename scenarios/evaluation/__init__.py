"""Compares correctors on the same frames, by the truth or by pixels that are held out.

`suite` runs all `methods` on the frames of all `sources`: `running` times one of them, `scoring` sums its errors by the
pixel `groups`, and `result_cache` keeps its `measurements`. `report` and `figures` show the numbers that `quantities`
lists; `paper` holds those that the paper prints.
"""
