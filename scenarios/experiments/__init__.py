"""Experiments: each module asks one question of rendered sequences and answers it with a table."""
