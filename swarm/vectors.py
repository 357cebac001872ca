"""Arithmetic of vectors."""

import math

import numpy as np

from voxdepth.types import FloatArray, MaskImage


def length(vector: FloatArray) -> float:
    """Return the length of a vector of few numbers, for which `numpy.linalg.norm` takes several times as long."""
    return math.hypot(*vector.tolist())


def are_near(points_m: FloatArray, others_m: FloatArray, within_m: float) -> MaskImage:
    """Return which points, shape (n, 3), are within a distance of any of some others, shape (m, 3)."""
    squared_m2 = ((points_m[:, None] - others_m) ** 2).sum(axis=2)
    return np.asarray((squared_m2 <= within_m**2).any(axis=1))
