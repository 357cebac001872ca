"""The compiled loop that reads the evidence of a depth image, cell by cell."""

import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled
from voxdepth.types import FloatImage

MAX_RANK = 64
"""Number of the smallest depths of a cell that are kept to find its percentiles; the rank of one is limited to it."""


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


@compiled("void(f4[:, ::1], f4[:, ::1], i8[::1], i8[::1], i8, f4, f4, f8, f8, f8, f4[:, ::1], f4[:, ::1])")
def read_cells(
    depth_m: FloatImage,
    confidence: FloatImage,
    row_edges: npt.NDArray[np.int64],
    col_edges: npt.NDArray[np.int64],
    step: int,
    min_confidence: float,
    min_surface_confidence: float,
    min_trusted_share: float,
    free_share: float,
    surface_share: float,
    # output
    free_depth_m: FloatImage,
    surface_depth_m: FloatImage,
) -> None:
    """Find two percentiles of the depths of each cell, of which `swarm.evidence.EvidenceConfig` tells the meaning.

    A cell that is not free has a free depth of 0, and one without a surface has a surface depth of +inf.
    """
    trusted, shown = np.empty(MAX_RANK, np.float32), np.empty(MAX_RANK, np.float32)
    for i in range(len(row_edges) - 1):
        for j in range(len(col_edges) - 1):
            n, n_trusted, n_shown = 0, 0, 0
            for row in range(row_edges[i], row_edges[i + 1], step):
                for col in range(col_edges[j], col_edges[j + 1], step):
                    n += 1
                    z, c = depth_m[row, col], confidence[row, col]
                    if z > 0 and c >= min_surface_confidence:
                        keep_smallest(shown, n_shown, z)
                        n_shown += 1
                        if c >= min_confidence:
                            keep_smallest(trusted, n_trusted, z)
                            n_trusted += 1
            free_depth_m[i, j], surface_depth_m[i, j] = 0.0, np.inf
            if n_trusted > 0 and n_trusted >= min_trusted_share * n:
                free_depth_m[i, j] = trusted[min(int(free_share * n_trusted), MAX_RANK - 1)]
            if n_shown > 0:
                surface_depth_m[i, j] = shown[min(int(surface_share * n_shown), MAX_RANK - 1)]
