"""A cost map: a layer of a drone's voxel map at the height at which it flies, and paths through it."""

import math
from functools import cache, cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from voxdepth.arithmetic import cos, matmul, sin, without_ipp
from voxdepth.types import FloatArray, FloatImage, MaskImage

from .approach import DECEL_M_S2, ApproachLimits, stopping_speed_m_s
from .voxel_map import FREE, OCCUPIED, UNKNOWN, VOXEL_M

Indices = npt.NDArray[np.signedinteger]
NO_DISCS: FloatArray = np.empty((0, 3))
COSTS = np.array([1.0, 2.5, 12.0, 30.0, 30.0])
"""Cost of a path per metre through space of each state, in the order of `voxel_map.STATES`."""
BEYOND_COST = 1.5
"""Cost of a path per metre beyond the map."""
HYSTERESIS = 0.7
"""Cost of the path that was chosen before, as a share of its cost."""
REACHED_M = 0.3
"""A drone has reached a point of its path that is this near."""
LOOK_AHEAD = 4
"""Points of the path beyond its clear part to which a drone looks."""
CLEAR_M = 5.0
"""Length of the path up to which its clear part is sought."""
SIDESTEPS = np.array([[math.cos(a), math.sin(a)] for a in np.radians([0, 20, -20, 40, -40, 60, -60])])
"""Cosine and sine of the directions, relative to the wanted one, that are tried when that is not free."""
GOOD_ENOUGH = 0.7
"""Share of the wanted speed with which a direction needs no better one."""
COMPASS = np.column_stack([cos(np.arange(8) * np.pi / 4), sin(np.arange(8) * np.pi / 4)])
ESCAPE_M = 0.5
"""Distance at which a drone that stands too narrow compares directions."""
ESCAPE_SLOPE = 0.5
"""Growth of the clearance per distance that a drone keeps on its way out of a place that is too narrow."""
STEP_CELLS = 0.5
"""Distance between the places at which a direction is tested."""
PATH_CELL_M = 2 * VOXEL_M
"""Side of a cell of a path, which covers two by two cells of the map."""


class PlannedPath(NamedTuple):
    """The cheapest path that a map knows to a target."""

    points_m: FloatArray
    """Points (x, y) from the drone on, shape (n, 2)."""
    clear: int
    """Index of the last point, of those nearby, to which the straight line is free for the whole width of the drone."""

    def direction(self, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the direction to the last clear point, or to the one after it where that is reached."""
        is_reached = np.hypot(*(self.points_m[self.clear] - at_m[:2])) < REACHED_M
        return self._towards(self.clear + int(is_reached), at_m, otherwise)

    def look(self, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the direction to a point beyond the clear part of the path."""
        return self._towards(self.clear + LOOK_AHEAD, at_m, otherwise)

    def _towards(self, index: int, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the level direction to a point, shape (3,), or another one if the drone is there."""
        offset_m = self.points_m[min(index, len(self.points_m) - 1)] - at_m[:2]
        distance_m = np.hypot(*offset_m)
        return np.array([*offset_m / distance_m, 0.0]) if distance_m > 1e-6 else otherwise


class CostMap:
    """What is known of the air through which a drone flies at its height, and what paths through it cost.

    `half_width_m` is the clearance that it needs, from its centre to what is not free. Places are in the frame of the
    drone's odometry, to which `T_odom_world` leads from that of the world. The sides of the map are at least `reach_m`
    away. Paths are planned around `drones_m`, discs (x, y, radius) of shape (n, 3), which are no part of the map.
    """

    def __init__(
        self,
        state: npt.NDArray[np.uint8],
        origin_m: FloatArray,
        half_width_m: float,
        *,
        reach_m: float,
        T_odom_world: FloatArray,
        drones_m: FloatArray = NO_DISCS,
    ) -> None:
        self.T_odom_world = T_odom_world
        self.state = state
        """Worst state of each cell, shape (rows along y, columns along x): one of `voxel_map.STATES`."""
        self.origin_m = origin_m
        """Corner (x, y) of the first cell, shape (2,)."""
        self._reach_m = reach_m
        self._half_width = half_width_m / VOXEL_M
        self._clearance = _clearance(state)
        self._taken, self._passage = state, self._clearance
        """State and clearance with the other drones as surfaces."""
        if len(drones_m):
            self._taken = _with_discs(state, (drones_m - [*origin_m, 0.0]) / VOXEL_M)
            self._passage = _clearance(self._taken)

    def place(self, world_m: FloatArray) -> FloatArray:
        """Return places of the world, shape (..., 3), in the frame of the odometry."""
        return np.asarray(self.to_odom(world_m) + self.T_odom_world[:3, 3])

    def in_world(self, odom_m: FloatArray) -> FloatArray:
        """Return places in the frame of the odometry, shape (..., 3), in that of the world."""
        return self.to_world(odom_m - self.T_odom_world[:3, 3])

    def to_odom(self, world: FloatArray) -> FloatArray:
        """Return vectors of the world, shape (..., 3), in the frame of the odometry."""
        return matmul(world, self.T_odom_world[:3, :3].T)

    def to_world(self, odom: FloatArray) -> FloatArray:
        """Return vectors in the frame of the odometry, shape (..., 3), in that of the world."""
        return matmul(odom, self.T_odom_world[:3, :3])

    def state_at(self, at_m: FloatArray) -> int:
        """Return the state of the cell at a position (x, y); beyond the map, nothing is known."""
        x, y = self._cells(at_m)
        row, col = round(y), round(x)
        inside = 0 <= row < self.state.shape[0] and 0 <= col < self.state.shape[1]
        return int(self.state[row, col]) if inside else UNKNOWN

    def clearance_m(self, places_m: FloatArray) -> FloatArray:
        """Return the distance from each position (x, y), shape (..., 2), to the nearest space that is not free."""
        return VOXEL_M * np.maximum(_look_up(self._clearance, self._cells(places_m)), 0)

    def fits(self, places_m: FloatArray) -> MaskImage:
        """Return whether a drone has its whole width at each position (x, y), shape (..., 2), where no other one is."""
        return np.asarray(_look_up(self._passage, self._cells(places_m)) >= self._half_width)

    def free_length_m(self, at_m: FloatArray, along: FloatArray, longest_m: float) -> float:
        """Return how far a drone may plan to fly from a position in a direction of length 1 (x, y)."""
        return float(self._free_lengths_m(self._passage, at_m, along[None, :2], longest_m)[0])

    def safe_velocity(
        self, wanted_m_s: FloatArray, at_m: FloatArray, limits: ApproachLimits, decel_m_s2: float = DECEL_M_S2
    ) -> FloatArray:
        """Turn and shorten a velocity (x, y) so that a drone at a position can stop within free space.

        The first direction that keeps `GOOD_ENOUGH` of the speed is taken, or else the first that keeps most of it.
        Those beside the wanted one also respect the limits towards other drones, which the wanted one does already.
        """
        speed = math.sqrt(float(wanted_m_s[0]) ** 2 + float(wanted_m_s[1]) ** 2)
        x, y = (wanted_m_s / max(speed, 1e-9)).tolist()
        directions = matmul(SIDESTEPS, np.array([[x, y], [-y, x]]))
        free_m = self._free_lengths_m(self._clearance, at_m, directions, self._reach_m)
        allowed_m_s = np.minimum(stopping_speed_m_s(free_m, decel_m_s2), speed)
        share = matmul(directions, limits.towards.T)
        with np.errstate(divide="ignore", invalid="ignore"):
            approach_m_s = np.where(share > 1e-3, np.maximum(limits.speed_m_s / share, 0), np.inf)
        allowed_m_s[1:] = np.minimum(allowed_m_s[1:], approach_m_s[1:].min(axis=1, initial=np.inf))
        kept_m_s = allowed_m_s * SIDESTEPS[:, 0]
        first = (kept_m_s >= min(GOOD_ENOUGH * speed, kept_m_s.max() - 1e-6)).argmax()
        return np.asarray(allowed_m_s[first] * directions[first])

    def way_out(self, at_m: FloatArray) -> FloatArray:
        """Return what a drone misses to its width at a position, as a vector (x, y) to a more open side if one is."""
        here_m = self.clearance_m(at_m)
        missing_m = VOXEL_M * self._half_width - here_m
        if missing_m <= 0:
            return np.zeros(2)
        ahead_m = self.clearance_m(at_m[:2] + ESCAPE_M * COMPASS)
        best = ahead_m.argmax()
        return missing_m * COMPASS[best] if ahead_m[best] > here_m else np.zeros(2)

    def plan(self, at_m: FloatArray, target_m: FloatArray, before: PlannedPath | None = None) -> PlannedPath:
        """Return the cheapest path from a position to a target (x, y), or to the side of the map towards it.

        The path that was chosen `before` is a little cheaper, so that a drone does not hesitate between two paths. That
        of a drone beyond the map, where a storm may carry it, begins in the nearest cell.
        """
        cost = COSTS[self._blocked]
        if before is not None:
            cells = self._path_cells(before.points_m)
            row, col = cells[((cells >= 0) & (cells < cost.shape)).all(axis=1)].T
            cost[row, col] *= HYSTERESIS
        start = np.clip(self._path_cells(at_m), 0, np.array(cost.shape) - 1)
        path = _cheapest_path(cost, self._cost_to_go(target_m), *start.tolist())
        nearby = path[1 : 1 + round(CLEAR_M / PATH_CELL_M)]
        clear = [n for n, cell in enumerate(nearby, start=1) if _is_free_between(self._blocked, path[0], cell)]
        return PlannedPath(self.origin_m + PATH_CELL_M * (path[:, ::-1] + 0.5), max(clear, default=0))

    def _path_cells(self, places_m: FloatArray) -> Indices:
        """Return row and column of the cell of a path at each position (x, y), shape (..., 2)."""
        cells: Indices = np.floor((places_m[..., :2] - self.origin_m) / PATH_CELL_M).astype(np.intp)
        return cells[..., ::-1]

    @cached_property
    def _blocked(self) -> npt.NDArray[np.uint8]:
        """Worst state within reach of a drone in each cell of a path, which are fewer than those of the map."""
        blocked = cv2.dilate(self._taken, _disc(self._half_width + 0.5))
        rows, cols = blocked.shape
        return np.asarray(blocked.reshape(rows // 2, 2, cols // 2, 2).max(axis=(1, 3)))

    def _cells(self, places_m: FloatArray) -> FloatArray:
        """Return positions (x, y), shape (..., 2), in cells, whose middles have whole numbers."""
        return (places_m[..., :2] - self.origin_m) / VOXEL_M - 0.5

    def _free_lengths_m(
        self, clearance: FloatImage, at_m: FloatArray, directions: FloatArray, longest_m: float
    ) -> FloatArray:
        """Return how far a drone may fly in directions, shape (n, 2), before its clearance is less than its width.

        A drone that stands too narrow may leave in directions in which the clearance grows.
        """
        start = self._cells(at_m)
        ahead = STEP_CELLS * np.arange(1, math.ceil(longest_m / VOXEL_M / STEP_CELLS) + 1)
        least = _look_up(clearance, start) + ESCAPE_SLOPE * (ahead - 2 * STEP_CELLS)
        found = _look_up(clearance, start + ahead[:, None] * directions[:, None])
        is_narrow = found < np.minimum(least, self._half_width)
        return np.where(is_narrow.any(axis=1), VOXEL_M * STEP_CELLS * is_narrow.argmax(axis=1), longest_m)

    def _cost_to_go(self, target_m: FloatArray) -> FloatImage:
        """Return the cost that is left at the target, or at each cell of the sides if it lies beyond them."""
        rows, cols = self._blocked.shape
        left = np.full((rows, cols), np.inf, np.float32)
        x, y = (target_m[:2] - self.origin_m) / PATH_CELL_M - 0.5
        if -0.5 <= x < cols - 0.5 and -0.5 <= y < rows - 0.5:
            left[int(y + 0.5), int(x + 0.5)] = 0
            return left
        ends, away_x, away_y = [0, -1], np.arange(cols) - x, np.arange(rows)[:, None] - y
        left[ends, :] = BEYOND_COST * np.hypot(away_x, away_y[ends])
        left[:, ends] = BEYOND_COST * np.hypot(away_x[ends], away_y)
        return left


def _cheapest_path(cost: FloatArray, cost_to_go: FloatImage, row: int, col: int) -> Indices:
    """Return the cells (row, column) of the cheapest path from one, shape (n, 2), by Dijkstra's algorithm from its end.

    A step costs the mean of its two cells, `cost` per side of a cell, and the end of the path what is left to go there:
    it is a step from one more cell, whose cost is raised by 1, since steps must not be free.
    """
    a, b, starts, length = _steps(*cost.shape)
    costs, left, beyond = cost.ravel(), cost_to_go.ravel(), cost.size
    ends = np.flatnonzero(np.isfinite(left))
    steps = np.concatenate([length * (costs[a] + costs[b]) / 2, 1 + left[ends]])
    matrix = steps, np.concatenate([b, ends]), np.append(starts, len(steps))
    graph = csr_array(matrix, shape=(beyond + 1, beyond + 1))
    _, towards = dijkstra(graph, indices=beyond, return_predecessors=True)
    path = [row * cost.shape[1] + col]
    while towards[path[-1]] != beyond:
        path.append(int(towards[path[-1]]))
    return np.column_stack(np.divmod(path, cost.shape[1]))


@cache
def _steps(
    rows: int, cols: int
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32], npt.NDArray[np.int32], FloatArray]:
    """Return the steps from each cell of a map to its neighbours, diagonal ones included, as the rows of a CSR matrix.

    They are the two cells of each step, the first step of each cell, and the length of each step in cells.
    """
    offset = np.array([(y, x) for y in (-1, 0, 1) for x in (-1, 0, 1) if (y, x) != (0, 0)])
    cell = np.stack(np.divmod(np.arange(rows * cols), cols), axis=1)
    there = cell[:, None] + offset
    inside = ((there >= 0) & (there < (rows, cols))).all(axis=2)
    a, which = np.nonzero(inside)
    b = (there[..., 0] * cols + there[..., 1])[inside]
    starts = np.concatenate([[0], np.cumsum(inside.sum(axis=1))])
    return a.astype(np.int32), b.astype(np.int32), starts.astype(np.int32), np.hypot(*offset[which].T)


def _is_free_between(state: npt.NDArray[np.uint8], start: Indices, end: Indices) -> bool:
    """Return whether all cells on the straight line between two different cells (row, column) are free."""
    n = 2 * np.abs(end - start).max()
    row, col = np.floor(start + np.arange(n + 1)[:, None] / n * (end - start) + 0.5).astype(np.intp).T
    return bool((state[row, col] == FREE).all())


def _clearance(state: npt.NDArray[np.uint8]) -> FloatImage:
    """Return the distance of each cell to the nearest one that is not free, in cells, with a border of 0 around it.

    Beyond the map, no cell is free.
    """
    is_free = np.zeros((state.shape[0] + 2, state.shape[1] + 2), np.uint8)
    is_free[1:-1, 1:-1] = state == FREE
    with without_ipp():
        clearance = cv2.distanceTransform(is_free, cv2.DIST_L2, cv2.DIST_MASK_5) - np.float32(0.5)
    clearance[[0, -1]] = clearance[:, [0, -1]] = 0
    return clearance


def _look_up(clearance: FloatImage, cells: FloatArray) -> FloatArray:
    """Return the clearance at positions (x, y), shape (..., 2), in cells; 0 beyond the map."""
    rows, cols = clearance.shape
    inside = np.minimum(np.maximum(cells + 1.5, 0), (cols - 1, rows - 1)).astype(np.intp)
    return np.asarray(clearance[inside[..., 1], inside[..., 0]], np.float64)


def _with_discs(state: npt.NDArray[np.uint8], discs: FloatArray) -> npt.NDArray[np.uint8]:
    """Return a map in which discs (column, row, radius), in cells, are surfaces."""
    taken = state.copy()
    rows, cols = np.ogrid[: state.shape[0], : state.shape[1]]
    for col, row, radius in discs.tolist():
        taken[(cols + 0.5 - col) ** 2 + (rows + 0.5 - row) ** 2 < radius**2] = OCCUPIED
    return taken


@cache
def _disc(radius: float) -> npt.NDArray[np.uint8]:
    """Return which cells of a square have their middle within a radius of its middle, in cells."""
    offset = np.arange(-int(radius), int(radius) + 1)
    return np.asarray(offset**2 + offset[:, None] ** 2 < radius**2, np.uint8)
