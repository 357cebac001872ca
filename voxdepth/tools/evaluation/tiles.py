"""Tiles of the image: errors of pixels beside each other are alike, and a camera at rest repeats them in every frame.

How much is known is therefore counted in tiles, and not in pixels.
"""

from functools import cache

import numpy as np
import numpy.typing as npt

from ...types import MaskImage

ROWS, COLUMNS = 4, 6
TILES = ROWS * COLUMNS
"""Number of tiles of an image."""
MIN_TILES = 6
"""Smallest number of tiles with evaluated pixels from which something is concluded."""


def count(mask: MaskImage) -> npt.NDArray[np.int64]:
    """Return how many pixels of a mask of shape (H, W) are in each tile, row by row, shape (TILES,)."""
    return np.bincount(_tiles(mask.shape)[mask], minlength=TILES)


@cache
def _tiles(shape: tuple[int, ...]) -> npt.NDArray[np.int64]:
    """Return the tile of every pixel, shape (H, W)."""
    row, col = (np.arange(side) * parts // side for side, parts in zip(shape, (ROWS, COLUMNS), strict=True))
    return row[:, None] * COLUMNS + col
