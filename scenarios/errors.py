"""Errors raised by the commands of the testbed."""

from voxdepth.tools.errors import ToolError


class ScenarioError(ToolError):
    """A scenario, an option or a folder is not usable; the message says what was expected and what came."""
