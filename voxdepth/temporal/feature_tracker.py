"""Corners of one gray image found again in another."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import GrayImage, Intrinsics

Points = npt.NDArray[np.float32]
"""Pixels of the reduced image, shape (N, 2): column, row."""

CORNER_WINDOW_PX = 5
MIN_CORNER = 2e-4
"""Least smaller eigenvalue of a corner's gradients: photon noise alone stays below."""
LOCATE = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)


class TracksConfig(Model):
    """Where corners are looked for, and how they are followed."""

    width_px: int = Field(320, ge=64)
    """Width that the gray image is reduced to. Larger is more exact and slower."""
    cell_px: int = Field(16, ge=4)
    """The best corner of each cell of so many pixels a side is followed; smaller cells give more tracks."""
    window_px: int = Field(11, ge=5)
    """Side of what is compared around a corner."""
    levels: int = Field(2, ge=0)
    """Halvings of the image over which a corner is looked for: each doubles the motion that can be followed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A gray image at the size that is tracked on."""

    gray: GrayImage
    """Shape (h, w), uint8."""
    corners: Points
    """One per cell, where there is one."""


class Tracks:
    """Finds corners, and follows them by the pyramidal method of Lucas and Kanade (Bouguet 2000)."""

    def __init__(self, camera: Intrinsics, config: TracksConfig) -> None:
        self._config = config
        width = min(config.width_px, camera.width_px)
        self.scale = width / camera.width_px
        """Of the reduced image against the full one."""
        self._size = (width, max(1, round(camera.height_px * self.scale)))

    def view(self, gray: GrayImage) -> View:
        """An image with its corners, from a gray image of shape (H, W)."""
        small = np.asarray(cv2.resize(gray, self._size, interpolation=cv2.INTER_AREA), np.uint8)
        return View(gray=small, corners=self._corners(small))

    def follow(
        self, earlier: View, later: View, corners: Points, expected: Points
    ) -> tuple[Points, npt.NDArray[np.bool_]]:
        """Where corners of one view are in another.

        Args:
            earlier: Where the corners are known.
            later: Where they are looked for.
            corners: In the earlier view, shape (N, 2).
            expected: Where the search starts in the later view, shape (N, 2).

        Returns:
            Positions in the later view, shape (N, 2), and which of them were found, shape (N,).
        """
        window = (self._config.window_px, self._config.window_px)
        seen, status, _ = cv2.calcOpticalFlowPyrLK(
            earlier.gray,
            later.gray,
            corners,
            expected.copy(),
            winSize=window,
            maxLevel=self._config.levels,
            criteria=LOCATE,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        found = np.asarray(seen, np.float32)
        width, height = self._size
        inside = (found >= 0).all(axis=1) & (found[:, 0] <= width - 1) & (found[:, 1] <= height - 1)
        return found, (status.ravel() > 0) & inside

    def _corners(self, gray: GrayImage) -> Points:
        cell = self._config.cell_px
        rows, cols = gray.shape[0] // cell, gray.shape[1] // cell
        if not rows * cols:
            return np.empty((0, 2), np.float32)
        strength = cv2.cornerMinEigenVal(gray, CORNER_WINDOW_PX)[: rows * cell, : cols * cell]
        cells = strength.reshape(rows, cell, cols, cell).swapaxes(1, 2).reshape(rows * cols, cell * cell)
        best = cells.argmax(axis=1)
        number = np.flatnonzero(cells[np.arange(len(cells)), best] > MIN_CORNER)
        down, along = np.divmod(best[number], cell)
        corner = np.stack([number % cols * cell + along, number // cols * cell + down], axis=1)
        return corner.astype(np.float32)
