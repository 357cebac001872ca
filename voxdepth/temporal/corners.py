"""Corners: the pixels whose neighbourhood changes most in every direction (Shi and Tomasi 1994)."""

import numpy as np
from numba import float32, int32, int64, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, compiled
from ..types import FloatImage, GrayImage
from .tracking_camera import Pixels

WINDOW_PX = 5
"""Side of the neighbourhood."""
BORDER_PX = 1 + WINDOW_PX // 2
"""Border without corners: its gradients or its neighbourhoods lie beside the image."""
MIN_EIGENVALUE = np.float32(2e-4)
"""Corners have a larger minimal eigenvalue of the gradient matrix; photon noise stays below."""
SCALE = np.float32((1 / (4 * WINDOW_PX * 255)) ** 2)
"""Factor of a sum of products of two gradients by Sobel's operator, which makes it independent of the window and of the
range of the gray values."""


def find_corners(gray: GrayImage, cell_px: int) -> Pixels:
    """Column and row of the best corner of each whole cell of `cell_px` pixels a side, shape (N, 2)."""
    eigenvalue = np.zeros(gray.shape, np.float32)
    _min_eigenvalue(gray, eigenvalue)
    return _best_of_cells(eigenvalue, cell_px)


@compiled(void(BYTE_IMAGE, FLOAT_IMAGE))
def _min_eigenvalue(
    gray: GrayImage,
    # output
    eigenvalue: FloatImage,
) -> None:
    """The smaller eigenvalue of the gradient matrix of each pixel; the border stays as it is.

    The products of the gradients along columns (x) and rows (y) are summed over the rows of the window first: those of
    a new row come in, and those of the row that leaves the window go.
    """
    height, width = gray.shape
    products, sums = np.zeros((3, WINDOW_PX, width), np.int32), np.zeros((3, width), np.int32)
    xx, xy, yy = products[0], products[1], products[2]
    sum_xx, sum_xy, sum_yy = sums[0], sums[1], sums[2]
    for row in range(1, height - 1):
        slot = row % WINDOW_PX
        for col in range(1, width - 1):
            a, b, c = int32(gray[row - 1, col - 1]), int32(gray[row - 1, col]), int32(gray[row - 1, col + 1])
            d, f = int32(gray[row, col - 1]), int32(gray[row, col + 1])
            g, h, i = int32(gray[row + 1, col - 1]), int32(gray[row + 1, col]), int32(gray[row + 1, col + 1])
            x = (c - a) + int32(2) * (f - d) + (i - g)
            y = (g - a) + int32(2) * (h - b) + (i - c)
            sum_xx[col] += x * x - xx[slot, col]
            sum_xy[col] += x * y - xy[slot, col]
            sum_yy[col] += y * y - yy[slot, col]
            xx[slot, col], xy[slot, col], yy[slot, col] = x * x, x * y, y * y
        if row >= WINDOW_PX:
            for col in range(BORDER_PX, width - BORDER_PX):
                a, b, c = int32(0), int32(0), int32(0)
                for u in range(col - 2, col + 3):
                    a, b, c = a + sum_xx[u], b + sum_xy[u], c + sum_yy[u]
                half = (float32(a) - float32(c)) / float32(2)
                root = np.sqrt(half * half + float32(b) * float32(b))
                eigenvalue[row - 2, col] = SCALE * ((float32(a) + float32(c)) / float32(2) - root)


@compiled(int64(FLOAT_IMAGE, int64, int64, float32))
def _first_row(image: FloatImage, row: int, col: int, value: float) -> int:
    """The first row from a given one that has a value in a column, which must be there."""
    while image[row, col] != value:
        row += 1
    return row


@compiled(float32[:, ::1](FLOAT_IMAGE, int64))
def _best_of_cells(eigenvalue: FloatImage, cell_px: int) -> Pixels:
    """Column and row of the corner with the largest eigenvalue of each whole cell, shape (N, 2)."""
    rows, cols = eigenvalue.shape[0] // cell_px, eigenvalue.shape[1] // cell_px
    corners, n, best = np.empty((rows * cols, 2), np.float32), 0, np.empty(cols * cell_px, np.float32)
    for row in range(0, rows * cell_px, cell_px):
        for u in range(len(best)):
            best[u] = MIN_EIGENVALUE
        for v in range(row, row + cell_px):
            for u in range(len(best)):
                best[u] = max(best[u], eigenvalue[v, u])
        for first in range(0, len(best), cell_px):
            col = first
            for u in range(first, first + cell_px):
                col = u if best[u] > best[col] else col
            if best[col] > MIN_EIGENVALUE:
                corners[n, 0], corners[n, 1] = col, _first_row(eigenvalue, row, col, best[col])
                n += 1
    return corners[:n]
