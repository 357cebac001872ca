"""A horizontal slice of a drone's map, and ways on it."""

from functools import cache, cached_property
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, FloatImage

from .map_kernels import FREE, SURFACE, UNSEEN, cells_within
from .nearby import ApproachLimits
from .route_kernels import (
    Braking,
    cheapest_way,
    clearance_at,
    free_length,
    nearest_safe_velocity,
    worst_between,
)

if TYPE_CHECKING:
    from .free_map import MapConfig

STATES = ("free", "unseen", "vain", "given up", "surface")
"""Names of the states of a map, in the order of their numbers."""
NO_DISCS: FloatArray = np.empty((0, 3))
BEYOND_PRICE = 1.5
"""Price of a way per metre beyond the map."""
HABIT = 0.7
"""Price of the way that was chosen before, as a share of its price."""
REACHED_M = 0.3
"""A drone has reached a point of its way that is this near."""
LOOK_AHEAD = 4
"""Points of the way beyond its clear part to which a drone looks."""
CLEAR_M = 5.0
"""Length of the way up to which its clear part is sought."""
SIDESTEPS_RAD = np.radians([0, 20, -20, 40, -40, 60, -60])
"""Directions beside the wanted one that are tried when that is not free."""
COMPASS = np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)])
WAY_OUT_M = 0.5
"""Distance at which a drone that stands too narrow compares directions."""
ROUTE_CELLS = 2
"""Side of a cell of the route, in voxels."""


class Route(NamedTuple):
    """The cheapest way that a map knows to a target."""

    points_m: FloatArray
    """Points (x, y) from the drone on, shape (n, 2)."""
    clear: int
    """Index of the last point, of those nearby, to which the straight line is free for the whole width of the drone."""

    def direction(self, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the direction (x, y) to the last clear point, or to the one after it where that is reached."""
        reached = np.hypot(*(self.points_m[self.clear] - at_m)) < REACHED_M
        return self._towards(self.clear + int(reached), at_m, otherwise)

    def look(self, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the direction (x, y) to a point beyond the clear part of the way."""
        return self._towards(self.clear + LOOK_AHEAD, at_m, otherwise)

    def _towards(self, index: int, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the direction to a point, or another one if the drone is there."""
        offset_m = self.points_m[min(index, len(self.points_m) - 1)] - at_m
        distance_m = np.hypot(*offset_m)
        return offset_m / distance_m if distance_m > 1e-6 else otherwise


class Chart:
    """A horizontal slice of a map: what is known of the air through which a drone flies at its height.

    `width_m` is the clearance that it needs, from its centre to what is not free. Places are in the frame of the
    drone's odometry, to which `T_odom_world` leads from that of the world. Ways are planned around `drones_m`, discs
    (x, y, radius) of shape (n, 3), which are no part of the map.
    """

    def __init__(
        self,
        state: npt.NDArray[np.uint8],
        origin_m: FloatArray,
        width_m: float,
        config: "MapConfig",
        T_odom_world: FloatArray | None = None,
        drones_m: FloatArray = NO_DISCS,
    ) -> None:
        self.T_odom_world = np.eye(4) if T_odom_world is None else T_odom_world
        self.state = state
        """Worst state of each cell, shape (rows along y, columns along x): one of `STATES`."""
        self.origin_m = origin_m
        """Corner (x, y) of the first cell, shape (2,)."""
        self.voxel_m = config.voxel_m
        """Side of a cell."""
        self._config = config
        self._width = width_m / config.voxel_m
        self._clearance = _clearance(state)
        self._taken, self._passage = state, self._clearance
        """State and clearance with the other drones as surfaces."""
        if len(drones_m):
            self._taken = _with_discs(state, (drones_m - [*origin_m, 0.0]) / config.voxel_m)
            self._passage = _clearance(self._taken)

    @cached_property
    def _blocked(self) -> npt.NDArray[np.uint8]:
        """Worst state within reach of a drone in each cell of the route, which are fewer than those of the map."""
        blocked = cv2.dilate(self._taken, _disc(self._width + 0.5))
        pairs = np.maximum(blocked[::2], blocked[1::2])
        return np.asarray(np.maximum(pairs[:, ::2], pairs[:, 1::2]))

    def _cells(self, at_m: FloatArray) -> tuple[float, float]:
        """Return a position (x, y) in cells, whose middles have whole numbers."""
        side_m, (x_m, y_m) = self._config.voxel_m, self.origin_m.tolist()
        return (float(at_m[0]) - x_m) / side_m - 0.5, (float(at_m[1]) - y_m) / side_m - 0.5

    def clearance_m(self, at_m: FloatArray) -> float:
        """Return the distance from a position (x, y) to the nearest space that is not free."""
        return self._config.voxel_m * max(0.0, clearance_at(self._clearance, *self._cells(at_m)))

    def free_length_m(self, at_m: FloatArray, along: FloatArray, longest_m: float) -> float:
        """Return how far a drone may plan to fly from a position in a direction of length 1 (x, y)."""
        side_m = self._config.voxel_m
        x, y = self._cells(at_m)
        longest = longest_m / side_m
        length = free_length(self._passage, x, y, float(along[0]), float(along[1]), self._width, longest)
        return longest_m if length >= longest else side_m * length

    def restrain(self, velocity: FloatArray, at_m: FloatArray, limits: ApproachLimits, braking: Braking) -> FloatArray:
        """Return the safe velocity (x, y) that is nearest to a wanted one; see `nearest_safe_velocity`."""
        safe = np.array(velocity[:2])
        x, y = self._cells(at_m)
        towards, speed_m_s = np.ascontiguousarray(limits.towards), limits.speed_m_s
        nearest_safe_velocity(self._clearance, x, y, towards, speed_m_s, SIDESTEPS_RAD, braking, safe)
        return safe

    def way_out(self, at_m: FloatArray) -> FloatArray:
        """Return what a drone misses to its width at a position, as a vector (x, y) to a more open side if one is."""
        here_m = self.clearance_m(at_m)
        missing_m = self._config.voxel_m * self._width - here_m
        if missing_m <= 0:
            return np.zeros(2)
        ahead_m = [self.clearance_m(at_m[:2] + WAY_OUT_M * along) for along in COMPASS]
        best = int(np.argmax(ahead_m))
        return np.asarray(missing_m * COMPASS[best]) if ahead_m[best] > here_m else np.zeros(2)

    def is_free(self, at_m: FloatArray) -> bool:
        """Return whether a drone has its whole width at a position (x, y), which no other one takes."""
        return clearance_at(self._passage, *self._cells(at_m)) >= self._width

    def state_at(self, at_m: FloatArray) -> int:
        """Return the state of the cell at a position (x, y); beyond the map, nothing was seen."""
        x, y = self._cells(at_m)
        row, col = round(y), round(x)
        inside = 0 <= row < self.state.shape[0] and 0 <= col < self.state.shape[1]
        return int(self.state[row, col]) if inside else UNSEEN

    def route(self, at_m: FloatArray, target_m: FloatArray, before: Route | None = None) -> Route:
        """Return the cheapest way from a position inside of the map to a target (x, y), or to the side towards it.

        The way that was chosen `before` is a little cheaper, so that a drone does not hesitate between two ways.
        """
        c, shape, side_m = self._config, self._blocked.shape, ROUTE_CELLS * self._config.voxel_m
        price = np.array([1, c.unseen_price, c.vain_price, c.surface_price, c.surface_price], np.float32)[self._blocked]
        if before is not None:
            rows, cols = np.floor((before.points_m - self.origin_m) / side_m).astype(np.intp).T[::-1]
            inside = (rows >= 0) & (rows < shape[0]) & (cols >= 0) & (cols < shape[1])
            price[rows[inside], cols[inside]] *= np.float32(HABIT)
        row, col = self._route_cell(at_m)
        way = np.empty(self._blocked.size, np.int64)
        n = cheapest_way(price, self._left_to_pay(target_m), row, col, way)
        rows, cols = np.divmod(way[:n], shape[1])
        points_m = self.origin_m + side_m * (np.column_stack([cols, rows]) + 0.5)
        nearby = min(n - 1, round(CLEAR_M / side_m))
        clear = next(
            (k for k in range(nearby, 0, -1) if not worst_between(self._blocked, row, col, int(rows[k]), int(cols[k]))),
            0,
        )
        return Route(points_m, clear)

    def _route_cell(self, at_m: FloatArray) -> tuple[int, int]:
        side_m = ROUTE_CELLS * self._config.voxel_m
        col, row = np.floor((at_m[:2] - self.origin_m) / side_m).astype(int).tolist()
        return int(np.clip(row, 0, self._blocked.shape[0] - 1)), int(np.clip(col, 0, self._blocked.shape[1] - 1))

    def _left_to_pay(self, target_m: FloatArray) -> FloatImage:
        """Return the price that is left at the target, or at each cell of the sides if it lies beyond them."""
        (rows, cols), side_m = self._blocked.shape, ROUTE_CELLS * self._config.voxel_m
        left = np.full((rows, cols), np.inf, np.float32)
        x, y = (target_m[:2] - self.origin_m) / side_m - 0.5
        if -0.5 <= x < cols - 0.5 and -0.5 <= y < rows - 0.5:
            left[int(y + 0.5), int(x + 0.5)] = 0
            return left
        price, ends = np.float32(BEYOND_PRICE), [0, -1]
        away_x, away_y = np.arange(cols) - x, np.arange(rows)[:, None] - y
        left[ends, :] = price * np.hypot(away_x, away_y[ends]).astype(np.float32)
        left[:, ends] = price * np.hypot(away_x[ends], away_y).astype(np.float32)
        return left


def _clearance(state: npt.NDArray[np.uint8]) -> FloatImage:
    """Return the distance of each cell to the nearest one that is not free, in cells; beyond the map, none is."""
    is_free = np.zeros((state.shape[0] + 2, state.shape[1] + 2), np.uint8)
    is_free[1:-1, 1:-1] = state == FREE
    distance = cv2.distanceTransform(is_free, cv2.DIST_L2, cv2.DIST_MASK_5)[1:-1, 1:-1]
    return np.ascontiguousarray(distance) - np.float32(0.5)


def _with_discs(state: npt.NDArray[np.uint8], discs: FloatArray) -> npt.NDArray[np.uint8]:
    """Return a map in which discs (column, row, radius), in cells, are surfaces."""
    taken = state.copy()
    for col, row, radius in discs.tolist():
        near = tuple(slice(*cells_within(at, radius, 1.0, n)) for at, n in zip((row, col), state.shape, strict=True))
        rows, cols = np.ogrid[near]
        taken[near][(cols + 0.5 - col) ** 2 + (rows + 0.5 - row) ** 2 < radius**2] = SURFACE
    return taken


@cache
def _disc(radius: float) -> npt.NDArray[np.uint8]:
    """Return which cells of a square have their middle within a radius of its middle, in cells."""
    offset = np.arange(-int(radius), int(radius) + 1)
    return np.asarray(offset**2 + offset[:, None] ** 2 < radius**2, np.uint8)
