"""How the experiments measure: what is computed from frames and runs, and the rivals of the paper's steps.

An experiment says what is measured and which claims follow; the modules here know nothing of claims and figures.
"""
