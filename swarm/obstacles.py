"""From a depth image to a way that is free: a polar histogram, a cost per direction and a braking curve."""

import numpy as np
from pydantic import Field

from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Intrinsics

from .types import Choice, Histogram

WIDEST_BLOCK = 0.7
"""Sine of the widest angle that a surface blocks."""
FORBIDDEN = 100.0
"""Cost of a direction in which there is less room than the safe radius."""


class AvoidanceConfig(Model):
    """How near a drone goes to things, and what it makes of what it cannot see."""

    rows: int = Field(7, ge=1)
    cols: int = Field(15, ge=1)
    percentile: float = Field(8.0, ge=0, le=100)
    """Percentile of a cell's ranges that stands for it; 0 would brake for every noisy pixel."""
    min_valid_share: float = Field(0.15, gt=0, le=1)
    """Share of a cell's pixels that must be trusted; cells with fewer are unknown."""
    min_confidence: float = Field(0.2, ge=0, le=1)
    """Pixels of less confidence count as holes."""
    unknown_range_m: float = Field(2.0, gt=0)
    """Free range that an unknown cell is given: holes are not free, they cap the speed."""
    safe_radius_m: float = Field(0.9, gt=0)
    """Distance between the camera and a surface that is kept [m]: airframe and margin."""
    horizon_m: float = Field(7.0, gt=0)
    """Directions that are free this far cost nothing."""
    clear_weight: float = Field(15.0, ge=0)
    goal_weight: float = Field(2.0, ge=0)
    """Cost per radian away from the wanted direction."""
    previous_weight: float = Field(0.6, ge=0)
    """Cost per radian away from the direction chosen last; more swerves less."""
    climb_weight: float = Field(1.0, ge=0)
    """Cost per radian of climbing or sinking away from the wanted slope."""
    max_decel_m_s2: float = Field(2.5, gt=0)
    brake_gain_per_s: float = Field(1.5, gt=0)
    """Speed per distance in the last, linear part of braking."""
    blind_speed_m_s: float = Field(0.4, ge=0)
    """Speed up to which a drone shifts in directions outside of the image without turning there first."""


def braking_speed(distance_m: float | FloatArray, *, decel_m_s2: float, gain_per_s: float) -> FloatArray:
    """Speed from which a drone can stop within a distance: linear when close, a square root beyond.

    `D(x) = 0 for x <= 0; p x for x < a/p^2; sqrt(2 a x - a^2/p^2) otherwise` is smooth where its parts meet
    (Vasarhelyi et al. 2018, Sci. Robot. 3, eaat3536).

    Args:
        distance_m: Free distances [m], of any shape.
        decel_m_s2: Deceleration a in the outer part.
        gain_per_s: Slope p in the inner part.

    Returns:
        Speeds [m/s], shaped like `distance_m`.
    """
    a, p = decel_m_s2, gain_per_s
    x = np.maximum(distance_m, 0.0)
    outer = np.sqrt(np.maximum(2 * a * x - (a / p) ** 2, 0.0))
    return np.where(x < a / p**2, p * x, outer)


class HistogramBuilder:
    """Reduces depth images of one camera to histograms."""

    def __init__(self, intrinsics: Intrinsics, config: AvoidanceConfig) -> None:
        self._config = config
        rows, cols = config.rows, config.cols
        self._step = max(1, intrinsics.height_px // 120)
        row = np.arange(0, intrinsics.height_px, self._step)
        col = np.arange(0, intrinsics.width_px, self._step)
        row, col = row[: len(row) // rows * rows], col[: len(col) // cols * cols]
        y = (row - intrinsics.cy_px) / intrinsics.fy_px
        x = (col - intrinsics.cx_px) / intrinsics.fx_px
        self._used = (len(row), len(col))
        self._ray_length = np.sqrt(1 + x[None, :] ** 2 + y[:, None] ** 2).astype(np.float32)
        cell_y = y.reshape(rows, -1).mean(axis=1)
        cell_x = x.reshape(cols, -1).mean(axis=1)
        grid_y, grid_x = np.meshgrid(cell_y, cell_x, indexing="ij")
        directions = np.stack([grid_x, grid_y, np.ones_like(grid_x)], axis=-1)
        self._directions_cam = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        flat = self._directions_cam.reshape(-1, 3)
        self._angle_rad = np.arccos(np.clip(flat @ flat.T, -1, 1))

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
        nearest_m[unknown] = c.unknown_range_m
        R_world_cam = T_world_cam[:3, :3]
        return Histogram(
            origin_m=T_world_cam[:3, 3],
            range_m=nearest_m,
            unknown=unknown,
            directions_world=self._directions_cam @ R_world_cam.T,
            angle_rad=self._angle_rad,
            forward_world=R_world_cam[:, 2],
        )

    def _cells(self, depth_m: FloatImage) -> FloatImage:
        """Ranges grouped by cell, shape (rows, cols, pixels); +inf where invalid."""
        rows, cols = self._config.rows, self._config.cols
        height, width = self._used
        used = depth_m[:: self._step, :: self._step][:height, :width]
        ranges = np.where(used > 0, used * self._ray_length, np.float32(np.inf))
        blocks = ranges.reshape(rows, height // rows, cols, width // cols).swapaxes(1, 2)
        return blocks.reshape(rows, cols, -1)


class Avoidance:
    """Bends and brakes a wanted velocity by what the histogram shows."""

    def __init__(self, config: AvoidanceConfig) -> None:
        self._config = config

    def choose(self, wanted_m_s: FloatArray, histogram: Histogram, previous: FloatArray | None) -> Choice:
        """The velocity nearest to a wanted one that is safe.

        A wish to go where the camera does not look is granted if it is slow. Else the drone flies by what it sees, and
        stops and turns when the way leads backwards. In a dead end it turns to where there is most room.

        Args:
            wanted_m_s: Wanted velocity, shape (3,).
            histogram: What is free around.
            previous: Direction chosen last, shape (3,), or None.
        """
        speed = float(np.linalg.norm(wanted_m_s))
        goal = wanted_m_s / speed if speed > 1e-3 else histogram.forward_world
        if not self._in_view(goal, histogram):
            if speed <= self._config.blind_speed_m_s:
                return Choice(velocity_m_s=wanted_m_s, direction=goal, cell=None, clear_m=0.0)
            if float(goal @ histogram.forward_world) < 0:
                return Choice(velocity_m_s=np.zeros(3), direction=goal, cell=None, clear_m=0.0)
        directions = histogram.directions_world.reshape(-1, 3)
        clear_m = self._clear(histogram)
        if (clear_m <= self._config.safe_radius_m).all():
            clear_m = histogram.range_m.ravel()
        best = int(np.argmin(self._cost(directions, clear_m, goal, previous)))
        direction = self._refine(goal, directions[best], histogram)
        limit = self._speed_limit(float(clear_m[best]))
        cols = histogram.range_m.shape[1]
        return Choice(
            velocity_m_s=min(speed, limit) * direction,
            direction=direction,
            cell=divmod(best, cols),
            clear_m=float(clear_m[best]),
        )

    def _in_view(self, goal: FloatArray, histogram: Histogram) -> bool:
        cos_to_cells = histogram.directions_world.reshape(-1, 3) @ goal
        return bool(cos_to_cells.max() > np.cos(np.radians(8.0)))

    def _clear(self, histogram: Histogram) -> FloatArray:
        """Free distance in each direction, shape (n,).

        A surface at range r blocks all directions within asin(r_safe / r) of it, but never more than 45 degrees:
        what is already too near must not forbid to leave sideways. Unknown cells, and surfaces beyond the horizon,
        block only their own direction.
        """
        range_m = histogram.range_m.ravel()
        blocking = (range_m < self._config.horizon_m) & ~histogram.unknown.ravel()
        near_m = range_m[blocking]
        blocks_within = np.arcsin(np.minimum(self._config.safe_radius_m / np.maximum(near_m, 1e-6), WIDEST_BLOCK))
        blocked = histogram.angle_rad[:, blocking] <= blocks_within
        clear_m: FloatArray = np.where(blocked, near_m, np.inf).min(axis=1, initial=np.inf)
        return np.minimum(clear_m, range_m)

    def _cost(
        self, directions: FloatArray, clear_m: FloatArray, goal: FloatArray, previous: FloatArray | None
    ) -> FloatArray:
        c = self._config
        cost = c.clear_weight * np.maximum(0, 1 - clear_m / c.horizon_m) ** 2
        cost[clear_m <= c.safe_radius_m] += FORBIDDEN
        cost += c.goal_weight * np.arccos(np.clip(directions @ goal, -1, 1))
        cost += c.climb_weight * np.abs(
            np.arcsin(np.clip(directions[:, 2], -1, 1)) - np.arcsin(np.clip(goal[2], -1, 1))
        )
        if previous is not None:
            cost += c.previous_weight * np.arccos(np.clip(directions @ previous, -1, 1))
        return cost

    def _refine(self, goal: FloatArray, cell_direction: FloatArray, histogram: Histogram) -> FloatArray:
        """The wanted direction itself where the chosen cell contains it, else the cell's."""
        directions = histogram.directions_world.reshape(-1, 3)
        own_cell = directions[int(np.argmax(directions @ goal))]
        return goal if np.array_equal(own_cell, cell_direction) else cell_direction

    def _speed_limit(self, clear_m: float) -> float:
        c = self._config
        return float(
            braking_speed(clear_m - c.safe_radius_m, decel_m_s2=c.max_decel_m_s2, gain_per_s=c.brake_gain_per_s)
        )
