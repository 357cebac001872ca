"""Corners: the pixels whose neighbourhood changes most in every direction (Shi and Tomasi 1994)."""

import cv2
import numpy as np

from ..types import GrayImage
from .tracking_camera import Pixels

WINDOW_PX = 5
"""Side of the neighbourhood."""
MIN_EIGENVALUE = np.float32(2e-4)
"""Corners have a larger minimal eigenvalue of the gradient matrix; photon noise stays below."""


def find_corners(gray: GrayImage, cell_px: int) -> Pixels:
    """Column and row of the best corner of each whole cell of `cell_px` pixels a side, shape (N, 2)."""
    eigenvalue = np.asarray(cv2.cornerMinEigenVal(gray, WINDOW_PX), np.float32)
    rows, cols = (side // cell_px for side in gray.shape)
    whole = eigenvalue[: rows * cell_px, : cols * cell_px].reshape(rows, cell_px, cols, cell_px)
    cells = whole.swapaxes(1, 2).reshape(rows * cols, cell_px * cell_px)
    best = cells.argmax(axis=1)
    row, col = np.divmod(np.arange(rows * cols), max(cols, 1))
    corners = np.stack([col * cell_px + best % cell_px, row * cell_px + best // cell_px], axis=1)
    return np.asarray(corners[cells.max(axis=1) > MIN_EIGENVALUE], np.float32)
