"""What one depth image proves: how far each direction is free, and where it shows a surface."""

from itertools import zip_longest
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Intrinsics, MaskImage, Source

SAMPLED_ROWS = 120
"""Larger images are sampled so that about this number of rows is read."""
NO_DEPTH = np.float32(np.inf)
"""In place of the depths of pixels that are left out."""

CELL_DEG = 5.0
"""Angle that a cell of the image covers in its middle."""
MIN_CONFIDENCE = 0.72
"""Pixels of at least this confidence are trusted by default: a wrong one may cost the drone, and a right one that is
not trusted costs time."""
MIN_TRUSTED_SHARE = 0.6
"""Share of the pixels of a cell that must be trusted; a cell with fewer proves no free space."""
MAX_HIDDEN_M = 0.1
"""Largest width of the part of a cell without trusted pixels up to which the cell proves free space. Such a part may
hide the edge of a wall; at a given angle it is wider the farther away it is, so that the limit ends the free range."""
FREE_SHARE = 0.1
"""Quantile of the trusted depths up to which a cell is free, if it shows no surface before that; 0 would let one noisy
pixel decide."""
DISPARITY_ERROR_PX = 0.35
"""Error of the matched disparity, which shortens the free depth. It is a share of a pixel of the images that were
matched; they may be larger than the depth image."""
MIN_SURFACE_CONFIDENCE = 0.1
"""Pixels of at least this confidence show a surface: free space must be proven, and a surface need not. A doubtful
depth says that something may be near."""
SURFACE_SHARE = 0.08
"""Quantile of these depths at which a cell shows a surface."""
TRUST_NEAR_DRONES_M = 0.5
"""Measured depth within this distance of another drone is trusted by default: the radius of a drone, and an error of
its position as large. There is free space where a drone is."""
HOLE_RANGE_M = 40.0
"""Range up to which a hole is free where holes are free space."""

NO_DRONES_M: FloatArray = np.empty((0, 3))
FloatVector = npt.NDArray[np.float32]
Holes = Literal["free", "evidenced"]


class Evidence(NamedTuple):
    """Ranges along the middle of each cell of an image, shape (rows, cols)."""

    free_m: FloatImage
    """Range up to which the direction is proven to be free [m]; 0 if nothing is."""
    surface_m: FloatImage
    """Range at which the image shows a surface [m]; +inf without one."""


class InverseSensorModel:
    """Reads from the depth images of one camera what they prove: evidence for the voxels of an occupancy grid.

    With `evidenced` holes, only trusted depth proves free space: depth of enough confidence, and measured depth that
    agrees with the position of another drone. A corrector that compares images doubts what moves, so that by the
    confidence alone a swarm may stop behind its own drones. With `free` holes, every depth is trusted, and a pixel
    without depth proves free space up to the largest range, as in EGO-Planner (RA-L 2021).

    Args:
        intrinsics: Camera of the images.
        holes: What pixels without trusted depth are.
        min_confidence: Pixels of at least this confidence are trusted.
        trust_near_drones_m: So are measured pixels within this distance of the position of another drone.
        disparity_error_px: See `DISPARITY_ERROR_PX`; 0 for true depth.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        *,
        holes: Holes = "evidenced",
        min_confidence: float = MIN_CONFIDENCE,
        trust_near_drones_m: float = TRUST_NEAR_DRONES_M,
        disparity_error_px: float = DISPARITY_ERROR_PX,
    ) -> None:
        self._holes_are_free, self._min_confidence = holes == "free", np.float32(min_confidence)
        self._disparity_error_px = disparity_error_px
        self._near_m = 0.0 if self._holes_are_free else trust_near_drones_m  # All is trusted then, without a search.
        self.camera = i = intrinsics
        self.row_edges = _edges(i.height_px, i.fy_px)
        self.col_edges = _edges(i.width_px, i.fx_px)
        self.cell_of_row, self.cell_of_col = _cells(self.row_edges), _cells(self.col_edges)
        """Row or column of cells to which each row or column of pixels belongs, shape (H,) or (W,)."""
        narrowest_px = min(np.diff(edges).min() for edges in (self.row_edges, self.col_edges))
        self._step = int(max(1, min(i.height_px // SAMPLED_ROWS, narrowest_px)))
        self._pixels = self._pixels_of_cells()
        self._n_pixels = np.count_nonzero(self._pixels >= 0, axis=-1)
        col, row = (np.arange(0, n_px, self._step, dtype=np.float64) for n_px in (i.width_px, i.height_px))
        self._slope_of_col, self._slope_of_row = (col - i.cx_px) / i.fx_px, (row - i.cy_px) / i.fy_px
        """x/z and y/z of the sampled columns and rows, camera frame."""
        y = ((self.row_edges[1:] + self.row_edges[:-1] - 1) / 2 - i.cy_px) / i.fy_px
        x = ((self.col_edges[1:] + self.col_edges[:-1] - 1) / 2 - i.cx_px) / i.fx_px
        self._ray_length = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2).astype(np.float32)
        rays = np.stack([*np.meshgrid(x, y), np.ones((len(y), len(x)))], axis=-1)
        self.rays_cam: FloatArray = rays / self._ray_length[..., None]
        """Unit vector through the middle of each cell, camera frame, shape (rows, cols, 3)."""

    def range_of_error(self, error_m: float) -> float:
        """Return the range at which the error of the disparity is an error of the depth of `error_m` [m]."""
        return float(np.sqrt(error_m * self.camera.focal_baseline_px_m / max(self._disparity_error_px, 1e-6)))

    def cells(self, row_px: FloatVector, col_px: FloatVector) -> npt.NDArray[np.int64]:
        """Return the index of the cell, row by row, of each position in the image, in pixels from its corner."""
        row, col = row_px.astype(np.int64), col_px.astype(np.int64)
        return np.asarray(self.cell_of_row[row] * (self.cell_of_col[-1] + 1) + self.cell_of_col[col])

    def read(self, corrected: CorrectedDepth, drones_m: FloatArray = NO_DRONES_M) -> Evidence:
        """Return the evidence of an image; where it has no depth and no confidence, nothing is proven.

        Args:
            corrected: The image.
            drones_m: Positions of the other drones in the image, camera frame, shape (n, 3).
        """
        depth_m, confidence = (
            image[:: self._step, :: self._step] for image in (corrected.depth_m, corrected.confidence)
        )
        if self._holes_are_free:
            depth_m = np.where(depth_m > 0, depth_m, np.float32(HOLE_RANGE_M))
            confidence = np.ones_like(depth_m)
        shown_m = np.where((depth_m > 0) & (confidence >= np.float32(MIN_SURFACE_CONFIDENCE)), depth_m, NO_DEPTH)
        is_measured = corrected.source[:: self._step, :: self._step] == Source.SENSOR
        is_sure = (confidence >= self._min_confidence) | (is_measured & self._is_near(depth_m, drones_m))
        trusted_m = np.where(is_sure, shown_m, NO_DEPTH)
        surface_m, _ = self._quantile(shown_m, SURFACE_SHARE)
        free_m, n_trusted = self._quantile(trusted_m, FREE_SHARE)
        is_trusted = (n_trusted > 0) & (n_trusted >= MIN_TRUSTED_SHARE * self._n_pixels)
        with np.errstate(divide="ignore"):  # Cells that are trusted as a whole hide nothing.
            seen_m = MAX_HIDDEN_M / float(np.radians(CELL_DEG)) / (1 - n_trusted / self._n_pixels)
        free_m = np.where(is_trusted, np.minimum(np.minimum(free_m, surface_m), seen_m.astype(np.float32)), 0)
        # f B / (f B / z + s): the free depth if the disparity was too small by s.
        free_m /= 1 + free_m * np.float32(self._disparity_error_px / self.camera.focal_baseline_px_m)
        return Evidence(free_m * self._ray_length, surface_m * self._ray_length)

    def _is_near(self, depth_m: FloatImage, drones_m: FloatArray) -> MaskImage:
        """Return which sampled pixels show a point within `trust_near_drones_m` of one of the positions."""
        near = np.zeros(depth_m.shape, np.bool_)
        for x_m, y_m, z_m in drones_m[drones_m[:, 2] > -self._near_m].tolist():
            rows, cols = self._window(self._slope_of_row, y_m, z_m), self._window(self._slope_of_col, x_m, z_m)
            z = depth_m[rows, cols]
            dx_m, dy_m, dz_m = z * self._slope_of_col[cols] - x_m, z * self._slope_of_row[rows, None] - y_m, z - z_m
            near[rows, cols] |= dx_m * dx_m + dy_m * dy_m + dz_m * dz_m <= self._near_m**2
        return near

    def _window(self, slopes: FloatArray, at_m: float, depth_m: float) -> slice:
        """Return the part of ascending slopes in which points within `trust_near_drones_m` of a position may be."""
        nearest_m, sides_m = depth_m - self._near_m, (at_m - self._near_m, at_m + self._near_m)
        if nearest_m <= 0:
            return np.s_[:]
        ends = [side_m / end_m for side_m in sides_m for end_m in (nearest_m, depth_m + self._near_m)]
        return np.s_[int(np.searchsorted(slopes, min(ends))) : int(np.searchsorted(slopes, max(ends), "right"))]

    def _pixels_of_cells(self) -> npt.NDArray[np.int64]:
        """Return the indices of the sampled pixels of each cell, filled up with -1 to shape (rows, cols, n)."""
        n_rows, n_cols = len(self.row_edges) - 1, len(self.col_edges) - 1
        cell = n_cols * self.cell_of_row[:: self._step, None] + self.cell_of_col[:: self._step]
        pixels = [np.flatnonzero(cell == n) for n in range(n_rows * n_cols)]
        return np.array(list(zip_longest(*pixels, fillvalue=-1))).T.reshape(n_rows, n_cols, -1)

    def _quantile(self, depth_m: FloatImage, share: float) -> tuple[FloatImage, npt.NDArray[np.int64]]:
        """Return the quantile of a share of the depths of each cell, +inf without any, and how many it has."""
        cells = np.append(depth_m, NO_DEPTH)[self._pixels]
        cells.sort(axis=-1)
        n = np.count_nonzero(cells < NO_DEPTH, axis=-1)
        nth = np.minimum((share * n).astype(np.intp), n - 1)
        return np.take_along_axis(cells, nth[..., None], axis=-1)[..., 0], n


def _edges(n_px: int, focal_px: float) -> npt.NDArray[np.int64]:
    """Return the first pixel of each cell along a side of the image, and the number of pixels."""
    n_cells = max(1, round(n_px / (focal_px * float(np.radians(CELL_DEG)))))
    return np.linspace(0, n_px, min(n_cells, n_px) + 1).round().astype(np.int64)


def _cells(edges: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Return the number of the cell of each pixel along a side of the image."""
    return np.repeat(np.arange(len(edges) - 1), np.diff(edges))
