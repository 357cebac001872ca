"""Planning of paths: the cheapest one on a grid of cells, of which each covers two by two of a cost map."""

from functools import cache, cached_property
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from voxdepth.types import FloatArray, FloatImage

from .voxel_map import FREE, VOXEL_M

Indices = npt.NDArray[np.signedinteger]
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

    @property
    def beyond_m(self) -> FloatArray:
        """Points (x, y) beyond the last clear one, shape (n, 2)."""
        return self.points_m[self.clear + 1 :]

    def _towards(self, index: int, at_m: FloatArray, otherwise: FloatArray) -> FloatArray:
        """Return the level direction to a point, shape (3,), or another one if the drone is there."""
        offset_m = self.points_m[min(index, len(self.points_m) - 1)] - at_m[:2]
        distance_m = np.hypot(*offset_m)
        return np.array([*offset_m / distance_m, 0.0]) if distance_m > 1e-6 else otherwise


class Planner:
    """Plans paths at the height at which a drone flies.

    Args:
        state: Worst state of each cell of the cost map, shape (rows along y, columns along x), both even.
        origin_m: Corner (x, y) of its first cell, shape (2,).
        half_width: Clearance that the drone needs, in cells of the cost map.
    """

    def __init__(self, state: npt.NDArray[np.uint8], origin_m: FloatArray, half_width: float) -> None:
        self._state = state
        self._origin_m = origin_m
        self._half_width = half_width

    def plan(self, at_m: FloatArray, target_m: FloatArray, before: PlannedPath | None = None) -> PlannedPath:
        """Return the cheapest path from a position to a target (x, y), or to the side of the map towards it.

        The path that was chosen `before` is a little cheaper, so that a drone does not hesitate between two paths. For
        a drone outside of the map, as strong wind may carry it, the path begins in the nearest cell of the map.
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
        return PlannedPath(self._origin_m + PATH_CELL_M * (path[:, ::-1] + 0.5), max(clear, default=0))

    def _path_cells(self, points_m: FloatArray) -> Indices:
        """Return row and column of the cell of a path at each position (x, y), shape (..., 2)."""
        cells: Indices = np.floor((points_m[..., :2] - self._origin_m) / PATH_CELL_M).astype(np.intp)
        return cells[..., ::-1]

    @cached_property
    def _blocked(self) -> npt.NDArray[np.uint8]:
        """Worst state within reach of a drone in each cell of a path, which are fewer than those of the map."""
        blocked = cv2.dilate(self._state, _disc(self._half_width + 0.5))
        rows, cols = blocked.shape
        return np.asarray(blocked.reshape(rows // 2, 2, cols // 2, 2).max(axis=(1, 3)))

    def _cost_to_go(self, target_m: FloatArray) -> FloatImage:
        """Return the cost that is left at the target, or at each cell of the sides if it lies beyond them."""
        rows, cols = self._blocked.shape
        left = np.full((rows, cols), np.inf, np.float32)
        x, y = (target_m[:2] - self._origin_m) / PATH_CELL_M - 0.5
        if -0.5 <= x < cols - 0.5 and -0.5 <= y < rows - 0.5:
            left[int(y + 0.5), int(x + 0.5)] = 0
            return left
        ends, away_x, away_y = [0, -1], np.arange(cols) - x, np.arange(rows)[:, None] - y
        left[ends, :] = BEYOND_COST * np.hypot(away_x, away_y[ends])
        left[:, ends] = BEYOND_COST * np.hypot(away_x[ends], away_y)
        return left


def _cheapest_path(cost: FloatArray, cost_to_go: FloatImage, row: int, col: int) -> Indices:
    """Return the cells (row, column) of the cheapest path from one, shape (n, 2), by Dijkstra's algorithm from its end.

    A step costs the mean `cost` of its two cells for each side of a cell that it crosses. The cost that remains at the
    end of the path is that of one more step, from an additional node; 1 is added to it, because the graph must not have
    an edge of weight 0.
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


@cache
def _disc(radius: float) -> npt.NDArray[np.uint8]:
    """Return which cells of a square have their middle within a radius of its middle, in cells."""
    offset = np.arange(-int(radius), int(radius) + 1)
    return np.asarray(offset**2 + offset[:, None] ** 2 < radius**2, np.uint8)
