"""Errors raised by the corrector library."""

from collections.abc import Iterable
from difflib import get_close_matches


def printable(text: str) -> str:
    """Write what cannot be printed, as the bytes of a name of a file that are no UTF-8, as in Python."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class VoxDepthError(Exception):
    """Base of every error of `voxdepth`. Its text is one line without control characters, whatever it quotes."""

    def __str__(self) -> str:
        """Return the message, in which line ends and control characters are written as in Python."""
        return printable(super().__str__())


class FrameError(VoxDepthError, ValueError):
    """A frame or a stream of frames is invalid."""


class LateFrameError(FrameError):
    """A frame is not later than one before it; the stream may go on without it."""


class CorrectorUnavailableError(VoxDepthError, RuntimeError):
    """A corrector is closed, or another thread uses it, so that it corrects no frame."""


class CopyError(VoxDepthError, TypeError):
    """An object holds what cannot be copied or sent to another process, as threads or a memory of frames."""


class ConfigError(VoxDepthError, ValueError):
    """A configuration value is out of range, or a name is unknown."""


class PluginError(ConfigError):
    """Code that a user names as `module:factory` cannot be loaded, fails, or returns what it may not."""


class DatasetError(VoxDepthError, RuntimeError):
    """A dataset is of another format, or one of its files is missing, damaged or of another kind."""


class PipelineError(VoxDepthError, RuntimeError):
    """A stage of a pipeline failed with the error in `__cause__`, or a pipeline was run twice."""


def did_you_mean(*likely: str) -> str:
    """Ask in brackets for what may have been meant, to be added to an error; empty for nothing."""
    return f" (did you mean {' or '.join(likely)}?)" if likely else ""


def similar(wrong: str, names: Iterable[str], cutoff: float = 0.6) -> list[str]:
    """Return the two names that are most like a wrong one, by `difflib`, or else that it is a part of."""
    known = list(names)
    parts = [name for name in known if wrong and wrong.lower() in name.lower()]
    return get_close_matches(wrong, known, 2, cutoff) or parts[:2]


def no_such(kind: str, name: str, names: Iterable[str]) -> str:
    """Return the message about a name that does not exist among those that do."""
    known = list(names)
    return f"there is no {kind} {name!r}{did_you_mean(*similar(name, known))}; choose one of: {', '.join(known)}"
