"""From a depth image to a polar histogram: how far it is free in each direction."""

from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Intrinsics, MaskImage

from .types import Histogram


class HistogramConfig(Model):
    """What a drone makes of what it sees, and of what it cannot see."""

    rows: int = Field(7, ge=1)
    """Cells from the top to the bottom of the image."""
    cols: int = Field(15, ge=1)
    """Cells from its left to its right."""
    percentile: float = Field(8.0, ge=0, le=100)
    """Percentile of a cell's ranges that stands for it; 0 would brake for every noisy pixel."""
    min_valid_share: float = Field(0.15, gt=0, le=1)
    """Share of a cell's pixels that must be trusted; cells with fewer are unknown."""
    min_confidence: float = Field(0.2, ge=0, le=1)
    """Pixels of less confidence count as holes; 0 ignores confidence."""
    unknown: Literal["blocked", "free"] = "blocked"
    """What an unknown cell counts as: `blocked` at `unknown_range_m`, which caps the speed, or `free`."""
    unknown_range_m: float = Field(2.0, gt=0)
    """Free range that an unknown cell is given."""
    free_range_m: float = Field(40.0, gt=0)
    """The same where unknown cells count as free."""


class HistogramBuilder:
    """Reduces depth images of one camera to histograms.

    Args:
        intrinsics: Of the camera.
        config: See there.
        mount_cam_m: Where the camera sits, from the centre of the drone, in the camera frame, shape (3,).
    """

    def __init__(self, intrinsics: Intrinsics, config: HistogramConfig, mount_cam_m: FloatArray) -> None:
        self._config = config
        self._mount_cam_m = mount_cam_m
        rows, cols = config.rows, config.cols
        self._step = max(1, intrinsics.height_px // 120)
        row = _used(intrinsics.height_px, self._step, rows)
        col = _used(intrinsics.width_px, self._step, cols)
        self._first = (int(row[0]), int(col[0]))
        y = (row - intrinsics.cy_px) / intrinsics.fy_px
        x = (col - intrinsics.cx_px) / intrinsics.fx_px
        self._used = (len(row), len(col))
        self._ray_length = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2).astype(np.float32)
        cell_y = y.reshape(rows, -1).mean(axis=1)
        cell_x = x.reshape(cols, -1).mean(axis=1)
        grid_y, grid_x = np.meshgrid(cell_y, cell_x, indexing="ij")
        directions = np.stack([grid_x, grid_y, np.ones_like(grid_x)], axis=-1)
        self._directions_cam = directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def build(self, corrected: CorrectedDepth, T_world_cam: FloatArray) -> Histogram:
        """The histogram of a corrected image; `T_world_cam`, shape (4, 4), is the drone's own estimate."""
        c = self._config
        trusted = np.where(corrected.confidence >= c.min_confidence, corrected.depth_m, np.float32(0))
        range_m = self._cells(trusted)
        count = np.count_nonzero(range_m < np.inf, axis=-1)
        n_pixels = range_m.shape[-1]
        unknown = count < max(1, c.min_valid_share * n_pixels)
        at = np.minimum((count * (c.percentile / 100)).astype(np.intp), n_pixels - 1)
        range_m.sort(axis=-1)
        nearest_m = np.take_along_axis(range_m, at[..., None], axis=-1)[..., 0].astype(np.float64)
        nearest_m[unknown] = c.unknown_range_m if c.unknown == "blocked" else c.free_range_m
        return self._from_the_centre(nearest_m, unknown, T_world_cam)

    def _from_the_centre(self, nearest_m: FloatArray, unknown: MaskImage, T_world_cam: FloatArray) -> Histogram:
        """Ranges from the camera, shape (rows, cols), as seen from the centre of the drone."""
        surface_cam_m = nearest_m[..., None] * self._directions_cam + self._mount_cam_m
        range_m = np.sqrt((surface_cam_m * surface_cam_m).sum(axis=-1))
        R_world_cam = T_world_cam[:3, :3]
        return Histogram(
            camera_m=T_world_cam[:3, 3],
            origin_m=T_world_cam[:3, 3] - R_world_cam @ self._mount_cam_m,
            range_m=range_m,
            unknown=unknown,
            directions_world=self._directions_cam @ R_world_cam.T,
            to_surface_world=surface_cam_m / np.maximum(range_m, 1e-9)[..., None] @ R_world_cam.T,
            forward_world=R_world_cam[:, 2],
        )

    def _cells(self, depth_m: FloatImage) -> FloatImage:
        """Ranges grouped by cell, shape (rows, cols, pixels); +inf where invalid."""
        rows, cols = self._config.rows, self._config.cols
        (row, col), (height, width) = self._first, self._used
        used = depth_m[row :: self._step, col :: self._step][:height, :width]
        ranges = np.where(used > 0, used * self._ray_length, np.float32(np.inf))
        blocks = ranges.reshape(rows, height // rows, cols, width // cols).swapaxes(1, 2)
        return blocks.reshape(rows, cols, -1)


def _used(n_pixels: int, step: int, n_cells: int) -> npt.NDArray[np.intp]:
    """Every `step`-th pixel along a side of the image, as many for each cell; what is left over lies at both ends."""
    n_used = len(range(0, n_pixels, step)) // n_cells * n_cells
    first = (n_pixels - 1 - step * (n_used - 1)) // 2
    return np.arange(first, first + step * n_used, step)
