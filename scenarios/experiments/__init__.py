"""The experiments of the paper: each module asks one question of it, and answers it with one table.

A module has the name of its command, `voxdepth experiment NAME`; `catalogue.py` lists them.
"""
