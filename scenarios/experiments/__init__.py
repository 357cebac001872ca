"""The experiments of the paper: each module asks one question of it, and answers it with one table.

A module has the name of its command, `voxdepth experiment NAME`; `catalogue.py` lists them. It reads from top to
bottom: what is run, its table and figure, and the claims of the paper; `measures/` computes what is measured.
"""
