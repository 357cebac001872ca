"""Obstacle avoidance by a polar histogram: the free range per direction, a cost per direction and a braking curve."""

import numpy as np
import numpy.typing as npt
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Intrinsics, MaskImage

from .braking import braking_speed
from .errors import MissionError
from .evidence import SAMPLED_ROWS
from .types import Choice, Histogram
from .vectors import length

COS_IN_VIEW = float(np.cos(np.radians(8.0)))
"""A direction within this angle of the middle of a cell is in the field of view."""
MAX_BLOCKED_SINE = 0.7
"""Sine of the widest angle that a surface blocks."""
TOO_NEAR_COST = 100.0
"""Cost of a direction in which a surface is nearer than the clearance."""


class HistogramConfig(Model):
    """Cells of the histogram, and the range of those without depth."""

    rows: int = Field(default=7, ge=1, le=181)
    """Number of cells from the top to the bottom of the image."""
    cols: int = Field(default=15, ge=1, le=361)
    """Number of cells from the left to the right of the image."""
    percentile: float = Field(default=8.0, ge=0, le=100)
    """Percentile of the ranges in a cell that is the range of the cell; 0 would brake for every noisy pixel."""
    min_valid_share: float = Field(default=0.15, gt=0, le=1)
    """Share of a cell's pixels that must be trusted; cells with fewer are unknown."""
    min_confidence: float = Field(default=0.2, ge=0, le=1)
    """Pixels of less confidence count as holes; 0 ignores confidence."""
    unknown_range_m: float = Field(default=2.0, gt=0)
    """Range of unknown cells that count as surfaces, which limits the speed."""
    free_range_m: float = Field(default=40.0, gt=0)
    """Range of unknown cells that count as free."""


class AvoidanceConfig(Model):
    """Distances and costs of obstacle avoidance. Clearance is the gap between the collision sphere and a surface."""

    histogram: HistogramConfig = HistogramConfig()
    clearance_m: float = Field(default=0.65, gt=0)
    """Clearance that is kept to surfaces in view [m]; more of it flies around obstacles in a wider arc."""
    horizon_m: float = Field(default=7.0, gt=0)
    """Directions that are free up to this distance cost nothing."""
    clear_weight: float = Field(default=15.0, ge=0)
    """Cost of a blocked direction; the cost falls with the square of the distance missing to the horizon."""
    goal_weight: float = Field(default=2.0, ge=0)
    """Cost per radian away from the wanted direction."""
    previous_weight: float = Field(default=0.6, ge=0)
    """Cost per radian away from the direction chosen last; more swerves less."""
    climb_weight: float = Field(default=1.0, ge=0)
    """Cost per radian of climbing or sinking away from the wanted elevation."""
    max_decel_m_s2: float = Field(default=2.5, gt=0)
    """Deceleration that braking assumes; less of it brakes earlier."""
    brake_gain_per_s: float = Field(default=1.5, gt=0)
    """Speed per distance in the last, linear part of braking."""
    blind_speed_m_s: float = Field(default=0.4, ge=0)
    """Speed up to which a drone moves in directions outside of the image without turning there first."""


class HistogramBuilder:
    """Reduces depth images of one camera to histograms.

    `mount_cam_m` is the position of the camera relative to the centre of the drone, in the camera frame, shape (3,).
    Unknown cells count as surfaces at a fixed range, or as free.
    """

    def __init__(
        self,
        intrinsics: Intrinsics,
        config: HistogramConfig,
        mount_cam_m: FloatArray,
        unknown_range_m: float,
    ) -> None:
        self._config = config
        self._unknown_m = unknown_range_m
        self._mount_cam_m = mount_cam_m
        rows, cols = config.rows, config.cols
        self._step = max(1, intrinsics.height_px // SAMPLED_ROWS)
        row = _sampled_pixels(intrinsics.height_px, self._step, rows)
        col = _sampled_pixels(intrinsics.width_px, self._step, cols)
        if not (len(row) and len(col)):
            raise MissionError(
                f"every {self._step}. pixel of images of {intrinsics.width_px}x{intrinsics.height_px} is read: too few "
                f"for a histogram of {rows} rows and {cols} columns; give it fewer, or larger images"
            )
        self._first = (int(row[0]), int(col[0]))
        y = (row - intrinsics.cy_px) / intrinsics.fy_px
        x = (col - intrinsics.cx_px) / intrinsics.fx_px
        self._sampled = (len(row), len(col))
        self._ray_length = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2).astype(np.float32)
        cell_y = y.reshape(rows, -1).mean(axis=1)
        cell_x = x.reshape(cols, -1).mean(axis=1)
        grid_y, grid_x = np.meshgrid(cell_y, cell_x, indexing="ij")
        directions = np.stack([grid_x, grid_y, np.ones_like(grid_x)], axis=-1)
        self._directions_cam = directions / np.linalg.norm(directions, axis=-1, keepdims=True)

    def build(self, corrected: CorrectedDepth, T_world_cam: FloatArray) -> Histogram:
        """Return the histogram of a corrected image; `T_world_cam` is the pose of the camera, shape (4, 4)."""
        c = self._config
        trusted = np.where(corrected.confidence >= c.min_confidence, corrected.depth_m, np.float32(0))
        range_m = self._cells(trusted)
        count = np.count_nonzero(range_m < np.inf, axis=-1)
        n_pixels = range_m.shape[-1]
        unknown = count < max(1, c.min_valid_share * n_pixels)
        rank = np.minimum((count * (c.percentile / 100)).astype(np.intp), n_pixels - 1)
        range_m.sort(axis=-1)
        nearest_m = np.take_along_axis(range_m, rank[..., None], axis=-1)[..., 0].astype(np.float64)
        nearest_m[unknown] = self._unknown_m
        return self._from_drone_centre(nearest_m, unknown, T_world_cam)

    def _from_drone_centre(self, nearest_m: FloatArray, unknown: MaskImage, T_world_cam: FloatArray) -> Histogram:
        """Convert ranges from the camera, shape (rows, cols), to ranges from the centre of the drone."""
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
        """Return the ranges grouped by cell, shape (rows, cols, pixels); +inf where invalid."""
        rows, cols = self._config.rows, self._config.cols
        (row, col), (height, width) = self._first, self._sampled
        sampled = depth_m[row :: self._step, col :: self._step][:height, :width]
        ranges = np.where(sampled > 0, sampled * self._ray_length, np.float32(np.inf))
        blocks = ranges.reshape(rows, height // rows, cols, width // cols).swapaxes(1, 2)
        return blocks.reshape(rows, cols, -1)


def _sampled_pixels(n_pixels: int, step: int, n_cells: int) -> npt.NDArray[np.intp]:
    """Return every `step`-th pixel along a side of the image, equally many per cell; the rest lies at both ends."""
    n_sampled = len(range(0, n_pixels, step)) // n_cells * n_cells
    first = (n_pixels - 1 - step * (n_sampled - 1)) // 2
    return np.arange(first, first + step * n_sampled, step)


class Avoidance:
    """Bends and brakes a wanted velocity by the free ranges of a histogram; `radius_m` is that of the drone."""

    def __init__(self, config: AvoidanceConfig, radius_m: float) -> None:
        self._config = config
        self._safety_radius_m = radius_m + config.clearance_m
        self._histogram: Histogram | None = None
        self._free_m: FloatArray = np.empty(0)
        """Free distance in each direction of the histogram."""

    def choose(
        self, wanted_m_s: FloatArray, histogram: Histogram, previous: FloatArray | None, at_m: FloatArray | None = None
    ) -> Choice:
        """Return the safe velocity that is nearest to a wanted one.

        A slow velocity out of the field of view is granted. Otherwise the drone follows the histogram, and stops and
        turns when the wanted direction leads backwards. In a dead end it compares the ranges of the cells alone.
        All vectors have the shape (3,). `previous` is the direction chosen last, and `at_m` the position of the drone
        when a command takes effect, or None if it has not moved since the histogram was taken. The distance to that
        position is not available for braking.
        """
        speed = length(wanted_m_s)
        goal = wanted_m_s / speed if speed > 1e-3 else histogram.forward_world
        directions = histogram.directions_world.reshape(-1, 3)
        nearest = int((directions @ goal).argmax())
        in_view = float(directions[nearest] @ goal) > COS_IN_VIEW
        if not in_view:
            if speed <= self._config.blind_speed_m_s:
                return Choice(velocity_m_s=wanted_m_s, direction=goal, cell=None, free_m=0.0)
            if float(goal @ histogram.forward_world) < 0:
                return Choice(velocity_m_s=np.zeros(3), direction=goal, cell=None, free_m=0.0)
        free_m = self._free_distances_m(histogram)
        best = int(self._costs(directions, free_m, goal, previous).argmin())
        # A direction outside of the image has a nearest cell as well, but that cell does not contain it.
        direction = goal if best == nearest and in_view else directions[best]
        travelled_m = 0.0 if at_m is None else max(0.0, float((at_m - histogram.origin_m) @ direction))
        c, left_m = self._config, float(free_m[best]) - travelled_m - self._safety_radius_m
        limit = float(braking_speed(left_m, c.max_decel_m_s2, c.brake_gain_per_s))
        cell = divmod(best, histogram.range_m.shape[1])
        velocity_m_s = min(speed, limit) * direction
        return Choice(velocity_m_s=velocity_m_s, direction=direction, cell=cell, free_m=float(free_m[best]))

    def _free_distances_m(self, histogram: Histogram) -> FloatArray:
        """Return the free distance in each direction, shape (n,); it is computed once per histogram.

        A surface at range r blocks all directions within asin(safety radius / r) of it, but never more than 45 degrees,
        so that a drone can leave a surface sideways that is already too near. Unknown cells, and surfaces beyond the
        horizon, block only their own direction. If all directions are blocked, their own ranges count.
        """
        if histogram is not self._histogram:
            range_m, unknown = histogram.range_m.ravel(), histogram.unknown.ravel()
            blocking = (range_m < self._config.horizon_m) & ~unknown
            sine = np.minimum(self._safety_radius_m / np.maximum(range_m[blocking], 1e-6), MAX_BLOCKED_SINE)
            cosine = histogram.directions_world.reshape(-1, 3) @ histogram.to_surface_world.reshape(-1, 3)[blocking].T
            blocked_m = np.where(cosine >= np.sqrt(1 - sine**2), range_m[blocking], np.inf).min(axis=1, initial=np.inf)
            free_m = np.minimum(range_m, blocked_m)
            self._histogram = histogram
            self._free_m = range_m if (free_m <= self._safety_radius_m).all() else free_m
        return self._free_m

    def _costs(
        self, directions: FloatArray, free_m: FloatArray, goal: FloatArray, previous: FloatArray | None
    ) -> FloatArray:
        """Return the cost of each direction, shape (n,), by its free distance and by what it is turned away from."""
        c = self._config
        costs = c.clear_weight * np.maximum(0, 1 - free_m / c.horizon_m) ** 2
        costs += TOO_NEAR_COST * (free_m <= self._safety_radius_m)
        costs += c.goal_weight * _angle(directions @ goal)
        costs += c.climb_weight * np.abs(_angle(directions[:, 2]) - _angle(goal[2]))
        return costs if previous is None else costs + c.previous_weight * _angle(directions @ previous)


def _angle(cosine: FloatArray) -> FloatArray:
    """Return the angle of each cosine [rad], which may be beyond 1 by rounding."""
    return np.arccos(np.clip(cosine, -1, 1))
