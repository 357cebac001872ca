"""Sparse feature tracking: one corner per grid cell, tracked by pyramidal Lucas-Kanade optical flow."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import GrayImage, Intrinsics

Points = npt.NDArray[np.float32]
"""Column and row of points in the tracking image, shape (N, 2)."""

CORNER_WINDOW_PX = 5
MIN_EIGENVALUE = 2e-4
"""Corners have a larger minimal eigenvalue of the gradient matrix (Shi and Tomasi 1994); photon noise stays below."""
TERMINATION = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 8, 0.03)


class FeatureTrackerConfig(Model):
    """How corners are detected and tracked."""

    width_px: int = Field(320, ge=64)
    """Width of the tracking image, to which the gray image is reduced. More is more accurate and slower."""
    cell_px: int = Field(16, ge=4)
    """Side of the grid cells. The best corner of each cell is tracked, so smaller cells give more tracks."""
    window_px: int = Field(11, ge=5)
    """Side of the window that is compared around a corner."""
    pyramid_levels: int = Field(2, ge=0)
    """Halvings of the tracking image. Each one doubles the motion that can be tracked."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrackingImage:
    """A gray image reduced for tracking, with its corners."""

    gray: GrayImage
    """Gray image, shape (h, w), uint8."""
    corners: Points
    """At most one corner per grid cell."""


class FeatureTracker:
    """Detects corners, and tracks them by the pyramidal method of Lucas and Kanade (Bouguet 2000).

    `size` is the width and height of the tracking image, and `scale` its size by that of the full image.
    """

    def __init__(self, camera: Intrinsics, config: FeatureTrackerConfig) -> None:
        self._config = config
        width = min(config.width_px, camera.width_px)
        self.scale = width / camera.width_px
        self.size = (width, max(1, round(camera.height_px * self.scale)))

    def detect(self, gray: GrayImage) -> TrackingImage:
        """The tracking image and its corners, from a gray image of shape (H, W)."""
        reduced = np.asarray(cv2.resize(gray, self.size, interpolation=cv2.INTER_AREA), np.uint8)
        return TrackingImage(gray=reduced, corners=self._detect_corners(reduced))

    def track(
        self, source: TrackingImage, target: TrackingImage, corners: Points, initial: Points
    ) -> tuple[Points, npt.NDArray[np.bool_]]:
        """Track corners from the source to the target, where the search starts at the initial positions.

        The result is their positions in the target, shape (N, 2), and which of them were found, shape (N,).
        """
        positions, status, _ = cv2.calcOpticalFlowPyrLK(
            source.gray,
            target.gray,
            corners,
            initial.copy(),
            winSize=(self._config.window_px, self._config.window_px),
            maxLevel=self._config.pyramid_levels,
            criteria=TERMINATION,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        )
        tracked = np.asarray(positions, np.float32)
        inside = (tracked >= 0).all(axis=1) & (tracked <= np.array(self.size) - 1).all(axis=1)
        return tracked, (status.ravel() > 0) & inside

    def _detect_corners(self, gray: GrayImage) -> Points:
        """The pixel with the largest minimal eigenvalue of each cell, unless that is below `MIN_EIGENVALUE`."""
        cell = self._config.cell_px
        rows, cols = gray.shape[0] // cell, gray.shape[1] // cell
        if not rows * cols:
            return np.empty((0, 2), np.float32)
        eigenvalue = cv2.cornerMinEigenVal(gray, CORNER_WINDOW_PX)[: rows * cell, : cols * cell]
        by_cell = eigenvalue.reshape(rows, cell, cols, cell).swapaxes(1, 2).reshape(rows * cols, cell * cell)
        best = by_cell.argmax(axis=1)
        textured = np.flatnonzero(by_cell[np.arange(len(by_cell)), best] > MIN_EIGENVALUE)
        row, col = np.divmod(best[textured], cell)
        corners = np.stack([textured % cols * cell + col, textured // cols * cell + row], axis=1)
        return corners.astype(np.float32)
