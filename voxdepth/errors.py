"""Errors raised by the corrector library."""


class VoxDepthError(Exception):
    """Base of every error of `voxdepth`. Its text is one line without control characters, whatever it quotes."""

    def __str__(self) -> str:
        """Return the message, in which line ends and control characters are written as in Python."""
        message = super().__str__()
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)


class FrameError(VoxDepthError, ValueError):
    """A frame or a stream of frames is invalid."""


class ConfigError(VoxDepthError, ValueError):
    """A configuration value is out of range, or a name is unknown."""


class DatasetError(VoxDepthError, RuntimeError):
    """A dataset is of another format, or one of its files is missing, damaged or of another kind."""


class PipelineError(VoxDepthError, RuntimeError):
    """A stage of a pipeline failed with the error in `__cause__`, or a pipeline was run twice."""
