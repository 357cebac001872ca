"""Errors raised by the corrector library."""


class VoxDepthError(Exception):
    """Base of every error that `voxdepth` raises on purpose."""


class FrameError(VoxDepthError, ValueError):
    """A frame, or a stream of frames, is not what a corrector can work on."""


class ConfigError(VoxDepthError, ValueError):
    """A configuration value or a name is outside what is offered."""


class DatasetError(VoxDepthError, RuntimeError):
    """A folder of images is not what it should be, or a file of it is missing, damaged or of another kind."""


class PipelineError(VoxDepthError, RuntimeError):
    """A stage of a pipeline failed, as its `__cause__` says, or a pipeline was to run twice."""
