"""Search for the open sky."""

import numpy as np
import numpy.typing as npt
from numba import boolean, int64

from ..compiled import BYTE_IMAGE, compiled
from ..types import GrayImage, MaskImage

CELL_PX = 4
"""Side of the cells in which the sky is searched, in working pixels. The middle pixel of a cell has its gray."""
MAX_KNOWN = 0.75
"""Fraction of a cell of the sky that may be known: the sky has wrong matches."""
MIN_SHARE = 0.02
"""Fraction of the image that a region of sky covers at least."""
GRAY_QUANTILE = 0.8
"""Fraction of the known pixels in the lower half of the image that the sky is brighter than."""
NEIGHBOURS = ((-1, 0), (0, -1), (0, 1), (1, 0))
"""Steps to the cells that are connected to a cell."""


@compiled(int64(BYTE_IMAGE, BYTE_IMAGE, int64))
def _gray_below_sky(known: GrayImage, gray: GrayImage, rows: int) -> int:
    """Gray that the sky is brighter than: a quantile of the known cells in the lower half; 255 if there are none."""
    n_of_gray, n_known, n_darker = np.zeros(256, np.int64), 0, 0
    for row in range(rows // 2 * CELL_PX + CELL_PX // 2, known.shape[0], CELL_PX):
        for col in range(CELL_PX // 2, known.shape[1], CELL_PX):
            if known[row, col] > 0:
                n_of_gray[gray[row, col]] += 1
                n_known += 1
    for level in range(255):
        n_darker += n_of_gray[level]
        if n_darker > int(GRAY_QUANTILE * (n_known - 1)):
            return level
    return 255


@compiled(boolean(BYTE_IMAGE, int64, int64))
def _is_hole(known: GrayImage, cell_row: int, cell_col: int) -> bool:
    """Whether hardly any pixel of a cell is known."""
    n = n_known = 0
    for row in range(cell_row * CELL_PX, min((cell_row + 1) * CELL_PX, known.shape[0])):
        for col in range(cell_col * CELL_PX, min((cell_col + 1) * CELL_PX, known.shape[1])):
            n += 1
            n_known += known[row, col] > 0
    return n_known <= MAX_KNOWN * n


@compiled(boolean[:, ::1](BYTE_IMAGE, BYTE_IMAGE))
def _find_bright_holes(known: GrayImage, gray: GrayImage) -> MaskImage:
    """The cells that may be sky, shape (rows, cols)."""
    rows, cols = (known.shape[0] + 1) // CELL_PX, (known.shape[1] + 1) // CELL_PX
    min_gray = _gray_below_sky(known, gray, rows)
    may_be_sky = np.empty((rows, cols), np.bool_)
    for row in range(rows):
        for col in range(cols):
            is_bright = gray[row * CELL_PX + CELL_PX // 2, col * CELL_PX + CELL_PX // 2] > min_gray
            may_be_sky[row, col] = is_bright and _is_hole(known, row, col)
    return may_be_sky


@compiled(int64(int64, boolean[:, ::1], int64[:, ::1]))
def _take_region(
    first_col: int,
    # input and output
    may_be_sky: MaskImage,
    # output
    region: npt.NDArray[np.int64],
) -> int:
    """Take the cells that are connected to one of the first row: their rows and columns, and their number."""
    rows, cols = may_be_sky.shape
    region[0, 0], region[0, 1] = 0, first_col
    n, n_done = int(may_be_sky[0, first_col]), 0
    may_be_sky[0, first_col] = False
    while n_done < n:
        for down, right in NEIGHBOURS:
            row, col = region[n_done, 0] + down, region[n_done, 1] + right
            if 0 <= row < rows and 0 <= col < cols and may_be_sky[row, col]:
                may_be_sky[row, col] = False
                region[n, 0], region[n, 1] = row, col
                n += 1
        n_done += 1
    return n


@compiled(boolean[:, ::1](BYTE_IMAGE, BYTE_IMAGE))
def find_sky(known: GrayImage, gray: GrayImage) -> MaskImage:
    """Cells that may be open sky: bright regions without depth that reach the upper border.

    A bright wall or ceiling without texture looks the same. Known pixels are given as a mask of the size of the gray
    image. What remains at the lower and right border belongs to the cells beside it.
    """
    may_be_sky = _find_bright_holes(known, gray)
    rows, cols = may_be_sky.shape
    sky, region = np.zeros((rows, cols), np.bool_), np.empty((rows * cols, 2), np.int64)
    for first_col in range(cols):
        n = _take_region(first_col, may_be_sky, region)
        if n >= MIN_SHARE * rows * cols:
            for k in range(n):
                sky[region[k, 0], region[k, 1]] = True
    return sky
