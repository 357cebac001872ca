"""The map of one drone: where its images proved free space, where they showed a surface, and where they showed nothing.

The map is a grid of voxels around the drone, in the frame of its own odometry. Free space must be proven; that it
lasts is an assumption, which a drone makes for as long as its odometry is good.
"""

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from voxdepth.compiled import compile_all
from voxdepth.model import Model
from voxdepth.types import FloatArray, FloatImage, Intrinsics, MaskImage

from . import map_kernels as kernels
from .evidence import Evidence, EvidenceReader
from .map_kernels import FREE, Limits, Rules, View, Voxels
from .nearby import ApproachLimits
from .route_kernels import (
    Braking,
    cheapest_way,
    clearance_at,
    free_length,
    nearest_safe_velocity,
    worst_between,
)

MAX_VOXELS = 2**24
STATES = ("free", "unseen", "vain", "surface")
"""Names of the states of a map, in the order of their numbers."""
DRONE_MASK_RADIUS_M = 1.0
"""Surfaces within this distance of another drone belong to that drone."""
MARGIN_M = 2.0
"""The map moves when the drone is this far from its middle."""
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


class MapConfig(Model):
    """Size and rules of the map."""

    reach_m: float = Field(10.0, gt=2)
    """Distance from the drone to the sides of the map, at least."""
    height_m: float = Field(2.0, gt=0)
    """Height of the map, half above and half below the drone, at least."""
    voxel_m: float = Field(0.25, gt=0.01)
    """Horizontal side of a voxel."""
    layer_m: float = Field(0.5, gt=0.01)
    """Height of a voxel."""
    min_passed: int = Field(2, ge=1, le=100)
    """Images that must see through a voxel until it is free."""
    min_vain: int = Field(5, ge=1, le=100)
    """Images in a row that show nothing in a voxel nearer than `near_m`, until it is vain: looking does not help."""
    near_m: float = Field(4.0, gt=0)
    """Distance within which an image that shows nothing counts."""
    max_error_m: float = Field(0.5, gt=0)
    """Surfaces so far away that their range is less exact than this are not recorded; nothing behind them is free."""
    memory_s: float = Field(60.0, gt=0)
    """Time for which free space is remembered. Odometry drifts, and things move: less of it forgets both."""
    start_radius_m: float = Field(1.6, ge=0)
    """Space around the start that counts as free."""
    max_jump_m: float = Field(0.5, gt=0)
    """Motion between two images, beyond what the velocity explains, after which the map is forgotten."""
    unseen_price: float = Field(2.5, ge=1)
    """Price of a way per metre through space that was not seen; that of free space is 1."""
    vain_price: float = Field(12.0, ge=1)
    """Price through space in which looking showed nothing."""
    surface_price: float = Field(30.0, ge=1)
    """Price through surfaces."""

    @model_validator(mode="after")
    def _check(self) -> "MapConfig":
        layers, rows, cols = self.shape
        if layers * rows * cols > MAX_VOXELS:
            raise ValueError(
                f"the map would have {layers} x {rows} x {cols} voxels, more than {MAX_VOXELS}: make reach_m or "
                "height_m smaller, or voxel_m or layer_m larger"
            )
        return self

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of layers, rows and columns; the route needs even numbers of the latter."""
        side = 2 * ROUTE_CELLS * int(np.ceil((self.reach_m + MARGIN_M) / self.voxel_m / ROUTE_CELLS))
        return 2 * int(np.ceil(self.height_m / 2 / self.layer_m)), side, side


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
    drone's odometry, to which `T_odom_world` leads from that of the world.
    """

    def __init__(
        self,
        state: npt.NDArray[np.uint8],
        origin_m: FloatArray,
        width_m: float,
        config: MapConfig,
        T_odom_world: FloatArray | None = None,
    ) -> None:
        self.T_odom_world = np.eye(4) if T_odom_world is None else T_odom_world
        self.state = state
        """Worst state of each cell, shape (rows along y, columns along x): `FREE`, `UNSEEN`, `VAIN` or `SURFACE`."""
        self.origin_m = origin_m
        """Corner (x, y) of the first cell, shape (2,)."""
        self.voxel_m = config.voxel_m
        """Side of a cell."""
        self._config = config
        self._width = width_m / config.voxel_m
        distance = cv2.distanceTransform((state == FREE).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)
        self._clearance: FloatImage = np.asarray(distance, np.float32) - np.float32(0.5)
        side = 2 * int(np.ceil(self._width)) + 1
        reach = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
        blocked = cv2.dilate(state, reach)
        pairs = np.maximum(blocked[::2], blocked[1::2])
        self._blocked: npt.NDArray[np.uint8] = np.maximum(pairs[:, ::2], pairs[:, 1::2])

    def _cells(self, at_m: FloatArray) -> tuple[float, float]:
        """Return a position (x, y) in cells, whose middles have whole numbers."""
        x, y = (at_m[:2] - self.origin_m) / self._config.voxel_m - 0.5
        return float(x), float(y)

    def clearance_m(self, at_m: FloatArray) -> float:
        """Return the distance from a position (x, y) to the nearest space that is not free."""
        return self._config.voxel_m * max(0.0, clearance_at(self._clearance, *self._cells(at_m)))

    def free_length_m(self, at_m: FloatArray, along: FloatArray, longest_m: float) -> float:
        """Return how far a drone may fly from a position in a direction of length 1 (x, y) through free space."""
        side_m = self._config.voxel_m
        x, y = self._cells(at_m)
        length = free_length(self._clearance, x, y, float(along[0]), float(along[1]), self._width, longest_m / side_m)
        return side_m * length

    def restrain(self, velocity: FloatArray, at_m: FloatArray, limits: ApproachLimits, braking: Braking) -> FloatArray:
        """Return the safe velocity (x, y) that is nearest to a wanted one; see `nearest_safe_velocity`."""
        safe = np.array(velocity[:2])
        x, y = self._cells(at_m)
        towards, speed_m_s = np.ascontiguousarray(limits.towards), limits.speed_m_s
        nearest_safe_velocity(self._clearance, x, y, towards, speed_m_s, SIDESTEPS_RAD, braking, safe)
        return safe

    def way_out(self, at_m: FloatArray) -> FloatArray:
        """Return what a drone misses to its width at a position, as a vector (x, y) to the more open side."""
        missing_m = self._config.voxel_m * self._width - self.clearance_m(at_m)
        if missing_m <= 0:
            return np.zeros(2)
        best = max(COMPASS, key=lambda along: self.clearance_m(at_m[:2] + WAY_OUT_M * along))
        return np.asarray(missing_m * best)

    def is_free(self, at_m: FloatArray) -> bool:
        """Return whether a drone has its whole width at a position (x, y)."""
        return clearance_at(self._clearance, *self._cells(at_m)) >= self._width

    def state_at(self, at_m: FloatArray) -> int:
        """Return the state of the cell at a position (x, y); beyond the map, nothing was seen."""
        x, y = self._cells(at_m)
        row, col = round(y), round(x)
        inside = 0 <= row < self.state.shape[0] and 0 <= col < self.state.shape[1]
        return int(self.state[row, col]) if inside else kernels.UNSEEN

    def route(self, at_m: FloatArray, target_m: FloatArray, before: Route | None = None) -> Route:
        """Return the cheapest way from a position inside of the map to a target (x, y), or to the side towards it.

        The way that was chosen `before` is a little cheaper, so that a drone does not hesitate between two ways.
        """
        c, shape, side_m = self._config, self._blocked.shape, ROUTE_CELLS * self._config.voxel_m
        price = np.array([1, c.unseen_price, c.vain_price, c.surface_price], np.float32)[self._blocked]
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
        far = np.hypot(np.arange(cols)[None, :] - x, np.arange(rows)[:, None] - y).astype(np.float32)
        price = np.float32(BEYOND_PRICE)
        left[[0, -1], :], left[:, [0, -1]] = price * far[[0, -1], :], price * far[:, [0, -1]]
        return left


class FreeMap:
    """Collects the evidence of the images of one camera, whose cells are those of `reader`."""

    def __init__(self, config: MapConfig, reader: EvidenceReader, camera: Intrinsics) -> None:
        compile_all()
        self._config = c = config
        self._rules = Rules(c.min_passed, c.min_vain, c.near_m, c.memory_s, c.voxel_m, c.layer_m)
        rows, cols = (np.repeat(np.arange(len(e) - 1), np.diff(e)) for e in (reader.row_edges, reader.col_edges))
        self._view = View(camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px, rows, cols)
        self._rays_cam = reader.rays_cam
        self._max_surface_m = reader.range_of_error(c.max_error_m)
        self._voxels = Voxels(*(np.zeros(c.shape, t) for t in (np.uint8, np.uint8, np.uint8, np.float32)))
        self._cell, self._squared = np.empty(c.shape, np.int32), np.zeros(c.shape, np.float32)
        self._origin: npt.NDArray[np.int64] | None = None
        """Corner of the first voxel (x, y, z), in voxels."""

    @property
    def _sides_m(self) -> FloatArray:
        return np.array([self._config.voxel_m, self._config.voxel_m, self._config.layer_m])

    @property
    def origin_m(self) -> FloatArray:
        """Corner of the map (x, y, z), shape (3,)."""
        assert self._origin is not None, "start comes first"
        return np.asarray(self._origin * self._sides_m)

    def start(self, at_m: FloatArray, time_s: float) -> None:
        """Begin the map around a drone, whose surroundings count as free."""
        self.forget()
        self._follow(at_m)
        self.occupy(at_m, 0.0, self._config.start_radius_m, self._config.height_m / 2, time_s)

    def forget(self) -> None:
        """Forget everything."""
        for counts in self._voxels:
            counts[:] = 0
        self._origin = None

    def occupy(self, at_m: FloatArray, radius_m: float, width_m: float, half_height_m: float, time_s: float) -> None:
        """Make the place of a drone free, and what it keeps free around itself, up to `width_m` from its centre.

        A surface in the place itself, within `radius_m`, was an error; one around it may be true.
        """
        at_m, origin_m = np.ascontiguousarray(at_m), self.origin_m
        kernels.occupy(self._voxels, self._rules, origin_m, at_m, radius_m, width_m, half_height_m, time_s)

    def give_up(self, at_m: FloatArray, radius_m: float, half_height_m: float) -> None:
        """Make what is unknown in an upright cylinder vain, because looking did not help."""
        kernels.give_up(self._voxels, self._rules, self.origin_m, at_m, radius_m, half_height_m)

    def is_column_free(self, at_m: FloatArray, low_m: float, high_m: float, time_s: float) -> bool:
        """Return whether the column of voxels at a position (x, y) is free between two heights."""
        col, row, _ = ((at_m - self.origin_m) / self._sides_m).tolist()
        rows, cols = slice(max(int(row) - 1, 0), int(row) + 2), slice(max(int(col) - 1, 0), int(col) + 2)
        near = Voxels._make(np.ascontiguousarray(counts[:, rows, cols]) for counts in self._voxels)
        state = np.empty(near.passed.shape[1:], np.uint8)
        kernels.worst_states(near, self._rules, float(self.origin_m[2]), low_m, high_m, time_s, state)
        return bool((state == FREE).all())

    def update(self, evidence: Evidence, T_odom_cam: FloatArray, drones_m: FloatArray, time_s: float) -> None:
        """Add the evidence of an image; surfaces near the other drones `drones_m`, shape (n, 3), are these drones."""
        self._follow(T_odom_cam[:3, 3])
        free_m, surface_m = evidence
        is_near = surface_m < self._max_surface_m
        rows, cols = np.nonzero(is_near)
        points_m = surface_m[rows, cols, None] * self._rays_cam[rows, cols] @ T_odom_cam[:3, :3].T + T_odom_cam[:3, 3]
        is_body = _are_apart(points_m, drones_m, DRONE_MASK_RADIUS_M)
        is_near[rows, cols] = is_body
        half_m = np.float32(self._config.voxel_m / 2)
        limits = Limits(
            free=np.square(np.maximum(free_m - half_m, 0)),
            surface_from=np.square(np.maximum(surface_m - half_m, 0)),
            surface_to=np.square(surface_m + half_m),
            is_recorded=is_near,
        )
        T = np.ascontiguousarray(T_odom_cam)
        farthest_m = max(self._config.near_m, float(free_m.max()))
        kernels.project(self._rules, self._view, self.origin_m, T, farthest_m, self._cell, self._squared)
        kernels.judge(self._voxels, limits, self._cell, self._squared, self._config.near_m, time_s)
        kernels.show_surfaces(self._voxels, self._rules, self.origin_m, points_m[is_body])

    def chart(
        self, low_m: float, high_m: float, width_m: float, time_s: float, T_odom_world: FloatArray | None = None
    ) -> Chart:
        """Return the slice between two heights for a drone that needs a clearance of `width_m`."""
        state = np.empty(self._config.shape[1:], np.uint8)
        origin_m = self.origin_m
        kernels.worst_states(self._voxels, self._rules, float(origin_m[2]), low_m, high_m, time_s, state)
        return Chart(state, origin_m[:2], width_m, self._config, T_odom_world)

    def _follow(self, at_m: FloatArray) -> None:
        """Move the map, by whole voxels, so that a position is near its middle."""
        sides_m, shape = self._sides_m, np.array(self._config.shape[::-1])
        wanted = np.round(at_m / sides_m).astype(np.int64) - shape // 2
        if self._origin is None:
            self._origin = wanted
            return
        moved = wanted - self._origin
        limits = np.array([MARGIN_M, MARGIN_M, self._config.layer_m]) / sides_m
        if (np.abs(moved) < limits).all():
            return
        for counts in self._voxels:
            _shift(counts, moved[::-1])
        self._origin = wanted


def _are_apart(points_m: FloatArray, others_m: FloatArray, least_m: float) -> MaskImage:
    """Return which points, shape (n, 3), are at least that far from all others, shape (m, 3)."""
    squared = ((points_m[:, None] - others_m) ** 2).sum(axis=-1)
    return np.asarray(squared.min(axis=1, initial=np.inf) >= least_m**2)


def _shift(array: npt.NDArray[np.generic], by: npt.NDArray[np.int64]) -> None:
    """Move the content of an array against its axes, in place, and fill up with zeros."""
    before = array.copy()
    array[...] = 0
    to, of = [], []
    for n, d in zip(array.shape, by.tolist(), strict=True):
        if abs(d) >= n:
            return
        to.append(slice(max(-d, 0), n - max(d, 0)))
        of.append(slice(max(d, 0), n - max(-d, 0)))
    array[tuple(to)] = before[tuple(of)]
