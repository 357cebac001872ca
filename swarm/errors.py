"""Errors raised by the swarm."""


class MissionError(ValueError):
    """A mission cannot be flown as configured."""
