"""Arithmetic of vectors."""

import math

from voxdepth.types import FloatArray


def length(vector: FloatArray) -> float:
    """Return the length of a vector of few numbers, for which `numpy.linalg.norm` takes several times as long."""
    return math.hypot(*vector.tolist())
