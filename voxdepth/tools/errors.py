"""Errors raised by the command line and what it runs."""

from ..errors import VoxDepthError


class ToolError(VoxDepthError):
    """An option, a file or a folder is not usable; the message says what was expected and what came."""
