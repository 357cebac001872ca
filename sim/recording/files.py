"""Reading and writing files so that no image is ever seen half-written."""

from contextlib import suppress
from pathlib import Path

from ..errors import RecordingError

TEMPORARY = ".tmp"
"""Added to the name of a file until it is whole."""


def read(path: Path) -> bytes:
    """All of a file.

    Raises:
        RecordingError: It is missing or cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise RecordingError(
            f"cannot read {path}: {error.strerror or error}; restore it from a copy or record again"
        ) from error


def replace(path: Path, data: bytes) -> None:
    """Make a file, or give it another content, in one step.

    Raises:
        OSError: It cannot be written; what was there before still is.
    """
    temporary = path.with_name(path.name + TEMPORARY)
    try:
        write(temporary, data, "wb")
        temporary.replace(path)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise


def extend(path: Path, data: bytes) -> None:
    """Add to the end of a file.

    Raises:
        OSError: It cannot be written; a part of the data may have been added.
    """
    write(path, data, "ab")


def write(path: Path, data: bytes, mode: str) -> None:
    """Hand bytes to the operating system, into a file that is opened with `mode`.

    Raises:
        OSError: It did not take all of them.
    """
    with path.open(mode) as file:
        file.write(data)
