"""Errors raised by the command line and what it runs."""


class ScenarioError(Exception):
    """A scenario, an option or a folder is not usable; the message says what was expected and what came."""
