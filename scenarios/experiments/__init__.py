"""The experiments of the paper by name, asked again of our rendered sequences: each makes a table and a figure."""
