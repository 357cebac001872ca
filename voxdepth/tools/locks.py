"""Folders that one process at a time writes to."""

import fcntl
import os
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
        handle = os.open(folder / LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise ToolError(f"cannot write to {folder}: {error.strerror}; choose a writable folder") from error
    try:
        _flock(handle, folder, busy)
        yield
    finally:
        os.close(handle)


def _flock(handle: int, folder: Path, busy: str) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise ToolError(busy) from error
    except OSError as error:
        raise ToolError(f"cannot lock {folder}: {error.strerror}; choose a folder on another disk") from error
