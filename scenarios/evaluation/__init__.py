"""Compares correctors on the same frames, by the truth or by pixels that are held out.

| module | what it holds |
|---|---|
| `methods` | what is compared |
| `sources` | sequences of frames with their references, and these on disk while all methods run |
| `groups` | masks and ranges of pixels |
| `running` | runs one method on one sequence |
| `scoring` | scores its depth |
| `measurements` | the long table of all numbers, and queries on it |
| `result_cache` | finished results in files |
| `suite` | runs all methods on all sequences |
| `quantities` | what each table shows |
| `report`, `figures` | tables, page and terminal output; figures |
| `paper` | numbers that the paper prints |
"""
