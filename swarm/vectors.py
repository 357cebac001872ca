"""Arithmetic of single vectors."""

import math

from voxdepth.types import FloatArray


def length(vector: FloatArray) -> float:
    """Return the length of a vector of shape (3,); `numpy.linalg.norm` takes four times as long for so few numbers."""
    return math.sqrt(vector @ vector)
