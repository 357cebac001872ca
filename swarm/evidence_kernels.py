"""The compiled loop that reads the evidence of a depth image, cell by cell."""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, float64, int64, void
from numba.types import Array, UniTuple

from voxdepth.compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled, named_tuple
from voxdepth.types import FloatImage


@compiled("void(f4[::1], i8, f4)")
def keep_smallest(smallest: FloatImage, n_seen: int, value: float) -> None:
    """Insert a value into the sorted smallest ones of `n_seen` values that came before."""
    last = min(n_seen, len(smallest) - 1)
    if n_seen >= len(smallest) and value >= smallest[last]:
        return
    place = last
    while place > 0 and smallest[place - 1] > value:
        smallest[place] = smallest[place - 1]
        place -= 1
    smallest[place] = value


class Trust(NamedTuple):
    """Which pixels prove what; see `swarm.evidence.EvidenceConfig`."""

    min_confidence: float
    min_surface_confidence: float
    min_trusted_share: float
    hidden_m: float
    """Range at which the part of a cell that may hide a surface is as wide as it may be, if that is all of the cell."""
    free_share: float
    surface_share: float
    step: int


PART = Array(float32, 2, "A", readonly=True)
TRUST = named_tuple(Trust, *[float64] * 6, int64)


@compiled(UniTuple(float64, 2)(PART, PART, TRUST))
def read_cell(depth_m: FloatImage, confidence: FloatImage, trust: Trust) -> tuple[float, float]:
    """Find the free depth of a part of an image, 0 if it is not free, and its surface depth, +inf without a surface."""
    n_sampled = ((depth_m.shape[0] - 1) // trust.step + 1) * ((depth_m.shape[1] - 1) // trust.step + 1)
    trusted = np.empty(int(trust.free_share * n_sampled) + 1, np.float32)
    shown = np.empty(int(trust.surface_share * n_sampled) + 1, np.float32)
    n_trusted, n_shown = 0, 0
    for row in range(0, depth_m.shape[0], trust.step):
        for col in range(0, depth_m.shape[1], trust.step):
            z, c = depth_m[row, col], confidence[row, col]
            if z > 0 and c >= trust.min_surface_confidence:
                keep_smallest(shown, n_shown, z)
                n_shown += 1
                if c >= trust.min_confidence:
                    keep_smallest(trusted, n_trusted, z)
                    n_trusted += 1
    free_m, surface_m = np.float32(0), np.float32(np.inf)
    if n_trusted > 0 and n_trusted >= trust.min_trusted_share * n_sampled:
        free_m = trusted[min(int(trust.free_share * n_trusted), n_trusted - 1)]
        if n_trusted < n_sampled:
            free_m = min(free_m, np.float32(trust.hidden_m / (1 - n_trusted / n_sampled)))
    if n_shown > 0:
        surface_m = shown[min(int(trust.surface_share * n_shown), n_shown - 1)]
        free_m = min(free_m, surface_m)
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
    """Read each cell of an image between two edges."""
    for i in range(len(row_edges) - 1):
        for j in range(len(col_edges) - 1):
            rows, cols = slice(row_edges[i], row_edges[i + 1]), slice(col_edges[j], col_edges[j + 1])
            free_depth_m[i, j], surface_depth_m[i, j] = read_cell(depth_m[rows, cols], confidence[rows, cols], trust)
