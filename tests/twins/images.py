"""The images on which loops and their twins are compared: random ones and degenerate ones, down to one pixel."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from voxdepth.temporal.working_resolution import MAX_DISPARITY_PX, MIN_DISPARITY_PX
from voxdepth.types import FloatImage

Shape = tuple[int, int]


def chosen(*values: float) -> Callable[[np.random.Generator, Shape], FloatImage]:
    """Images whose pixels are drawn from these values."""
    return lambda rng, shape: rng.choice(np.array(values, np.float32), shape)


def slanted(rng: np.random.Generator, shape: Shape) -> FloatImage:
    row, col = np.indices(shape)
    return (rng.uniform(1, 5) + 0.4 * row + 0.25 * col).astype(np.float32)


def lonely(rng: np.random.Generator, shape: Shape) -> FloatImage:
    """No two neighbours are of one surface: a chess board of near and far noise."""
    near = np.indices(shape).sum(axis=0) % 2
    return (rng.uniform(2, 5, shape) + 100 * near).astype(np.float32)


def noisy(rng: np.random.Generator, shape: Shape) -> FloatImage:
    """A few surfaces with noise and holes."""
    disparity_px = np.full(shape, rng.uniform(2, 20))
    for _ in range(4):
        top, left = rng.integers(0, shape[0]), rng.integers(0, shape[1])
        disparity_px[top : top + 8, left : left + 9] = rng.uniform(2, 40)
    disparity_px += rng.normal(0, 0.3, shape)
    return np.where(rng.random(shape) < 0.2, 0, disparity_px).astype(np.float32)


IMAGES: dict[str, Callable[[np.random.Generator, Shape], FloatImage]] = {
    "holes": chosen(0),
    "constant": chosen(6.5),
    "one surface": slanted,
    "lonely pixels": lonely,
    "small surfaces": chosen(0, 5, 6, 6.25, 7.5, 30),
    "quarters of a pixel": chosen(*np.arange(0, 12, 0.25)),
    "noisy surfaces": noisy,
    "extreme": chosen(0, float(MIN_DISPARITY_PX), 2e-4, 999.75, float(MAX_DISPARITY_PX)),
}
"""Disparities [px] of an image; 0 = invalid."""
SHAPES: list[Shape] = [(1, 1), (4, 4), (5, 7), (33, 46)]

each_shape = pytest.mark.parametrize("shape", SHAPES, ids=str)
each_image = pytest.mark.parametrize("image", IMAGES)


def spoiled(shape: tuple[int, ...], kind: type[Any] = np.float32) -> Any:
    """An output that has other values than any loop writes to it."""
    return np.full(shape, 77, kind)
