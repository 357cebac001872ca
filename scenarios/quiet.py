"""Libraries without their messages at start (PyBullet's build time)."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache


@cache
def import_noisy_libraries() -> None:
    """Import PyBullet without its output; errors are raised as usual."""
    with _terminal_silenced():
        import pybullet  # noqa: F401


@contextmanager
def _terminal_silenced() -> Iterator[None]:
    """Redirect stdout and stderr to the null device at the level of file descriptors, which C code uses."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept = [os.dup(1), os.dup(2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        for target, copy in zip((1, 2), kept, strict=True):
            os.dup2(copy, target)
            os.close(copy)
        os.close(nowhere)
