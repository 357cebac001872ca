"""The physics engine PyBullet, without what it writes to the terminal."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

__all__ = ["pybullet", "silenced"]


@contextmanager
def silenced() -> Iterator[None]:
    """Redirect stdout and stderr to the null device at the level of file descriptors, which C code uses."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
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


with silenced():  # It prints when it was built.
    import pybullet
