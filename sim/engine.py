"""The physics engine PyBullet, without what it writes to the terminal."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

__all__ = ["ContactPoint", "contact_points", "pybullet", "silenced"]


class ContactPoint(NamedTuple):
    """A point at which two bodies touch, or where they are nearest to each other."""

    body_a: int
    body_b: int
    on_b_m: tuple[float, float, float]
    """The point on the second body, in the world frame."""
    distance_m: float
    """Distance of both bodies; negative where they overlap."""


def contact_points(rows: Sequence[Sequence[Any]]) -> list[ContactPoint]:
    """Name what PyBullet's `getContactPoints` and `getClosestPoints` return as tuples without names."""
    return [ContactPoint(body_a=row[1], body_b=row[2], on_b_m=row[6], distance_m=float(row[8])) for row in rows]


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
