"""Rerun recordings: `mission` records a flight, `frames` a case of the regression."""
