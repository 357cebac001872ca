"""The physics engine PyBullet, without what it writes to the terminal."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

__all__ = ["pybullet", "silenced"]


@contextmanager
def silenced() -> Iterator[None]:
    """Redirect stdout and stderr to the null device at the level of file descriptors, which C code uses.

    A standard stream that was closed becomes the null device for good.
    """
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            with suppress(OSError):  # What cannot be written now is kept, and is an error of who writes it next.
                stream.flush()
    while (nowhere := os.open(os.devnull, os.O_RDWR)) <= 2:
        pass
    kept = [os.dup(1), os.dup(2)]
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
