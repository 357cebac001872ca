"""Folders that one process at a time writes to."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import ToolError

LOCK = "write.lock"
"""File on which `locked` holds its lock; it stays empty."""


@contextmanager
def locked(folder: Path, busy: str) -> Iterator[None]:
    """Make a folder and hold its write lock, which the system releases when the process ends in any way.

    The lock is on a file of its own that is open for writing, as network file systems require. A lock that another
    process holds is a `ToolError` with the message `busy`; an unwritable folder is one, too.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("a")
    except OSError as error:
        raise ToolError(f"cannot write to {folder}: {error.strerror}; choose a writable folder") from error
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ToolError(busy) from error
        except OSError as error:
            raise ToolError(f"cannot lock {folder}: {error.strerror}; choose a folder on another disk") from error
        yield
