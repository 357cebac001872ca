"""Errors raised by the swarm."""


class SwarmError(Exception):
    """Base of every error that `swarm` raises on purpose."""


class MissionError(SwarmError, ValueError):
    """A mission cannot be flown as configured."""
