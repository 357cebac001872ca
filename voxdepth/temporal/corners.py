"""Corners: the pixels whose neighbourhood changes most in every direction (Shi and Tomasi 1994)."""

import cv2
import numpy as np
from numba import float32, int64

from ..compiled import FLOAT_IMAGE, compiled
from ..types import FloatImage, GrayImage
from .tracking_camera import Pixels

WINDOW_PX = 5
"""Side of the neighbourhood."""
MIN_EIGENVALUE = np.float32(2e-4)
"""Corners have a larger minimal eigenvalue of the gradient matrix; photon noise stays below."""


def find_corners(gray: GrayImage, cell_px: int) -> Pixels:
    """Column and row of the best corner of each whole cell of `cell_px` pixels a side, shape (N, 2)."""
    return _best_of_cells(np.asarray(cv2.cornerMinEigenVal(gray, WINDOW_PX), np.float32), cell_px)


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
