"""The compiled loop that reads the evidence of a depth image, cell by cell."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, float64, int64, void
from numba.types import Array, UniTuple

from voxdepth.compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled, named_tuple
from voxdepth.types import FloatImage

FloatVector = npt.NDArray[np.float32]
NO_DEPTH = np.float32(np.inf)
"""In place of the depths of pixels that are left out."""


@compiled("void(f4[:, :], i8, f4[::1])")
def find_smallest(
    values: FloatImage,
    n_wanted: int,
    # output
    smallest: FloatVector,
) -> None:
    """Find the smallest values, in ascending order. It is fastest if the first rows have the smallest ones."""
    smallest[:n_wanted] = NO_DEPTH
    for row in range(values.shape[0]):
        for col in range(values.shape[1]):
            value = values[row, col]
            if value < smallest[n_wanted - 1]:
                for n in range(n_wanted):
                    other = smallest[n]
                    smallest[n], value = (value, other) if value < other else (other, value)


@compiled("i8(f4[:, :])")
def count_depths(values: FloatImage) -> int:
    """Return the number of pixels with a depth."""
    n = 0
    for row in range(values.shape[0]):
        for col in range(values.shape[1]):
            n += values[row, col] < NO_DEPTH
    return n


@compiled("i8(f8, i8)")
def quantile_index(share: float, n_values: int) -> int:
    """Return the index of the quantile of a share in values of ascending order."""
    return min(int(share * n_values), n_values - 1)


class Trust(NamedTuple):
    """Which pixels prove what; see `swarm.evidence.EvidenceConfig`."""

    min_confidence: float
    min_surface_confidence: float
    min_trusted_share: float
    hidden_m: float
    """Range at which the part of a cell that may hide a surface is as wide as it may be, if that is all of the cell."""
    free_share: float
    surface_share: float


PART = Array(float32, 2, "A")
TRUST = named_tuple(Trust, *[float64] * 6)


@compiled(UniTuple(float64, 2)(PART, PART, TRUST, float32[::1]))
def read_cell(
    shown_m: FloatImage,
    trusted_m: FloatImage,
    trust: Trust,
    # scratch
    smallest: FloatVector,
) -> tuple[float, float]:
    """Find the free depth of a cell, 0 if it is not free, and its surface depth, +inf without a surface.

    The depths that show a surface, and those of them that are trusted, are `NO_DEPTH` in other pixels.
    """
    n_shown, n_trusted = count_depths(shown_m), count_depths(trusted_m)
    if n_shown == 0:
        return 0.0, np.inf
    nth_shown, nth_trusted = quantile_index(trust.surface_share, n_shown), quantile_index(trust.free_share, n_trusted)
    find_smallest(shown_m, max(nth_shown, nth_trusted) + 1, smallest)
    surface_m = smallest[nth_shown]
    if n_trusted == 0 or n_trusted < trust.min_trusted_share * shown_m.size:
        return 0.0, float(surface_m)
    if n_trusted < n_shown:
        find_smallest(trusted_m, nth_trusted + 1, smallest)
    free_m = min(smallest[nth_trusted], surface_m)
    if n_trusted < shown_m.size:
        free_m = min(free_m, np.float32(trust.hidden_m / (1 - n_trusted / shown_m.size)))
    return float(free_m), float(surface_m)


@compiled(void(READABLE_IMAGE, READABLE_IMAGE, int64[::1], int64[::1], TRUST, FLOAT_IMAGE, FLOAT_IMAGE))
def read_cells(
    depth_m: FloatImage,
    confidence: FloatImage,
    row_edges: npt.NDArray[np.int64],
    col_edges: npt.NDArray[np.int64],
    trust: Trust,
    # output
    free_depth_m: FloatImage,
    surface_depth_m: FloatImage,
) -> None:
    """Find the free depth and the surface depth of each cell of an image, see `read_cell`; the edges are in its pixels.

    Rows are read from the lowest one up: the ground is nearest there.
    """
    least_shown, least_trusted = np.float32(trust.min_surface_confidence), np.float32(trust.min_confidence)
    most_rows, width = np.diff(row_edges).max(), depth_m.shape[1]
    shown_m, trusted_m = np.empty((most_rows, width), np.float32), np.empty((most_rows, width), np.float32)
    smallest = np.empty(most_rows * np.diff(col_edges).max(), np.float32)
    for i in range(len(row_edges) - 1):
        n_rows = row_edges[i + 1] - row_edges[i]
        for k in range(n_rows):
            row = row_edges[i + 1] - 1 - k
            for col in range(width):
                z, c = depth_m[row, col], confidence[row, col]
                shown_m[k, col] = z if (z > 0) & (c >= least_shown) else NO_DEPTH
                trusted_m[k, col] = shown_m[k, col] if c >= least_trusted else NO_DEPTH
        for j in range(len(col_edges) - 1):
            cols = slice(col_edges[j], col_edges[j + 1])
            cell = shown_m[:n_rows, cols], trusted_m[:n_rows, cols]
            free_depth_m[i, j], surface_depth_m[i, j] = read_cell(cell[0], cell[1], trust, smallest)
