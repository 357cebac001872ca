"""Rerun recordings: `mission` records a flight, `frames` a corrected sequence or a case of the regression."""
