"""The tables and figures that documents show, each remade by one command: `make results`, or `python -m tests.results`.

A result is `docs/results/NAME.json`: its tables, and by which commit, on which machine and on which day they were made.
`makers` lists all results; `of_frames`, `of_experiments`, `of_flights` and `of_installation` make them; `documents`
writes them into the documents.
"""
