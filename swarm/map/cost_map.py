"""A cost map: a layer of a drone's voxel map at the height at which it flies, and paths through it."""

import math

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import cos, length, matmul, sin, without_ipp
from voxdepth.types import FloatArray, FloatImage, MaskImage

from ..approach import DECEL_M_S2, ApproachLimits, stopping_speed_m_s
from .course import Intent, LocalRoute
from .planner import PlannedPath, Planner
from .voxel_map import FREE, OCCUPIED, UNKNOWN, VOXEL_M

NO_DISCS: FloatArray = np.empty((0, 3))
SIDESTEPS = np.array([[math.cos(a), math.sin(a)] for a in np.radians([0, 20, -20, 40, -40, 60, -60])])
"""Cosine and sine of the directions, relative to the wanted one, that are tried when that is not free."""
GOOD_ENOUGH = 0.7
"""Share of the wanted speed with which a direction needs no better one."""
COMPASS = np.column_stack([cos(np.arange(8) * np.pi / 4), sin(np.arange(8) * np.pi / 4)])
ESCAPE_M = 0.5
"""Distance at which a drone that stands too narrow compares directions."""
ESCAPE_SLOPE = 0.5
"""Growth of the clearance per distance that a drone keeps on its way out of a passage that is too narrow."""
STEP_CELLS = 0.5
"""Distance between the points at which a direction is tested."""
STAYS_M_S = 1e-3
"""A drone that wants to be slower wants to stay."""


class CostMap:
    """What is known of the air through which a drone flies at its height: which way it may go, and how fast.

    Points are in the frame of the drone's odometry.

    Args:
        state: Worst state of each cell, shape (rows along y, columns along x): one of `voxel_map.STATES`.
        origin_m: Corner (x, y) of the first cell, shape (2,).
        half_width_m: Clearance that the drone needs, from its centre to what is not free.
        reach_m: Distance to the sides of the map, at least.
        T_odom_world: Transform to the frame of the odometry from that of the world, shape (4, 4).
        drones_m: Discs (x, y, radius), shape (n, 3), around which paths are planned; they are no part of the map.
        before: The path that was planned last.
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
        before: PlannedPath | None = None,
    ) -> None:
        self.T_odom_world, self.state, self.origin_m = T_odom_world, state, origin_m
        self._reach_m = reach_m
        self._half_width = half_width_m / VOXEL_M
        self._clearance = _clearance(state)
        taken, self._passage = state, self._clearance
        """State and clearance with the other drones as surfaces."""
        if len(drones_m):
            taken = _with_discs(state, (drones_m - [*origin_m, 0.0]) / VOXEL_M)
            self._passage = _clearance(taken)
        self.planner = Planner(taken, origin_m, self._half_width)
        self._before = before
        self.path: PlannedPath | None = None
        """The path of this map; None until a route needs one."""

    def from_world(self, world_m: FloatArray) -> FloatArray:
        """Return points of the world, shape (..., 3), in the frame of the odometry."""
        return np.asarray(self.to_odom(world_m) + self.T_odom_world[:3, 3])

    def in_world(self, odom_m: FloatArray) -> FloatArray:
        """Return points in the frame of the odometry, shape (..., 3), in that of the world."""
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

    def clearance_m(self, points_m: FloatArray) -> FloatArray:
        """Return the distance from each position (x, y), shape (..., 2), to the nearest space that is not free."""
        return VOXEL_M * np.maximum(_look_up(self._clearance, self._cells(points_m)), 0)

    def fits(self, points_m: FloatArray) -> MaskImage:
        """Return whether a drone has its whole width at each position (x, y), shape (..., 2), where no other one is."""
        return np.asarray(_look_up(self._passage, self._cells(points_m)) >= self._half_width)

    @property
    def last_path(self) -> PlannedPath | None:
        """The path that was planned last, by this map or before it."""
        return self._before if self.path is None else self.path

    def route(self, intent: Intent, straight_m: float) -> LocalRoute:
        """Return which way a drone may go: straight ahead if that is free for a length, or else on the path."""
        at_m, speed_m_s, way_out_m = intent.at_m, intent.speed_m_s, self._way_out(intent.at_m)
        if speed_m_s < STAYS_M_S:
            return LocalRoute(np.zeros(3), np.zeros(3), way_out_m)
        ahead = np.array([*intent.wanted_m_s[:2] / speed_m_s, 0.0])
        left_m = length(intent.target_m[:2] - at_m[:2])
        if self.free_length_m(at_m, ahead, straight_m) >= min(straight_m, left_m):
            return LocalRoute(ahead, ahead, way_out_m)
        if self.path is None:
            self.path = self.planner.plan(at_m, intent.target_m, self._before)
        return LocalRoute(self.path.direction(at_m, ahead), self.path.look(at_m, ahead), way_out_m)

    def free_length_m(self, at_m: FloatArray, along: FloatArray, longest_m: float) -> float:
        """Return how far a drone may plan to fly from a position in a direction of length 1 (x, y)."""
        return float(self._free_lengths_m(self._passage, at_m, along[None, :2], longest_m)[0])

    def safe_velocity(
        self, wanted_m_s: FloatArray, at_m: FloatArray, limits: ApproachLimits, decel_m_s2: float = DECEL_M_S2
    ) -> FloatArray:
        """Turn and shorten a velocity (x, y) so that a drone at a position can stop within free space.

        The first direction that keeps `GOOD_ENOUGH` of the speed is taken, or else the first that keeps most of it.
        Those beside the wanted one also respect the limits towards other drones, which the wanted one does already.

        Args:
            wanted_m_s: Wanted horizontal velocity, in the frame of the odometry, shape (2,).
            at_m: Where the drone begins to brake, in the same frame, shape (2,) or (3,); its height does not count.
            limits: How fast the drone may approach others horizontally, in the same frame.
            decel_m_s2: Deceleration with which the drone brakes.
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

    def _way_out(self, at_m: FloatArray) -> FloatArray:
        """Return by how much the clearance at a position is too small, as a vector (x, y) towards a more open side."""
        here_m = self.clearance_m(at_m)
        missing_m = VOXEL_M * self._half_width - here_m
        if missing_m <= 0:
            return np.zeros(2)
        ahead_m = self.clearance_m(at_m[:2] + ESCAPE_M * COMPASS)
        best = ahead_m.argmax()
        return missing_m * COMPASS[best] if ahead_m[best] > here_m else np.zeros(2)

    def _cells(self, points_m: FloatArray) -> FloatArray:
        """Return positions (x, y), shape (..., 2), in cells, whose middles have whole numbers."""
        return (points_m[..., :2] - self.origin_m) / VOXEL_M - 0.5

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
