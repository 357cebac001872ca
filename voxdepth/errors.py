"""Errors raised by the corrector library."""


class VoxDepthError(Exception):
    """Base of every error that `voxdepth` raises on purpose."""


class FrameError(VoxDepthError, ValueError):
    """A frame, or a stream of frames, is not what a corrector can work on."""


class ConfigError(VoxDepthError, ValueError):
    """A configuration value or a name is outside what is offered."""
