"""Errors raised by the corrector library."""


class VoxDepthError(Exception):
    """Base of every error of `voxdepth`."""


class FrameError(VoxDepthError, ValueError):
    """A frame or a stream of frames is invalid."""


class ConfigError(VoxDepthError, ValueError):
    """A configuration value is out of range, or a name is unknown."""


class DatasetError(VoxDepthError, RuntimeError):
    """A dataset is of another format, or one of its files is missing, damaged or of another kind."""


class PipelineError(VoxDepthError, RuntimeError):
    """A stage of a pipeline failed with the error in `__cause__`, or a pipeline was run twice."""
