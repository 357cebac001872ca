"""The voxel map of one drone: where its images proved free space, where they hit a surface, and where they saw nothing.

The map is an occupancy grid around the drone, in the frame of its own odometry. Free space must be proven; that it
lasts is an assumption, which a drone makes for as long as its odometry is good. Arrays over the map have the shape
(layers, rows along y, columns along x), and indices of voxels that order.
"""

from functools import cache
from math import ceil, floor
from typing import Any

import numpy as np
import numpy.typing as npt
from pydantic import Field

from voxdepth.arithmetic import matmul
from voxdepth.model import Model
from voxdepth.types import FloatArray, FloatImage, MaskImage

from .evidence import Evidence, InverseSensorModel
from .frustum import FloatVector, Frustum

Bytes = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.int64]
FREE, UNKNOWN, UNOBSERVABLE, BLACKLISTED, OCCUPIED = range(5)
"""States of a voxel, from the best to the worst. It is unobservable where images from nearby show neither free space
nor a surface, and blacklisted where a drone did not get on although it knew that."""
STATES = ("free", "unknown", "unobservable", "blacklisted", "occupied")
"""Names of the states, in the order of their numbers."""
MAX_IMAGE_S = 0.1
"""Largest time for which one image counts; otherwise it counts for the time since the image before it. The images of a
fast camera then add up to the same evidence as those of a slow one, of which each counts for this time."""
HIT = 8
"""Factor of a hit. An image that shows a surface in a voxel (a hit) adds its time to the occupancy, multiplied by this;
an image that sees through the voxel (a miss) subtracts its time. A surface therefore survives several misses for each
hit: wrong images come in episodes, and one such episode must not erase a wall."""
OCCUPIED_MS = 900
"""Occupancy from which on a voxel is occupied. That is more than one image may add: two confirm a surface, and one
alone in free space is an error of depth."""
MAX_OCCUPANCY_MS = 6_000
"""Largest occupancy."""
MAX_MS = 20_000
"""Times that images add up end here."""
BLACKLISTED_MS = MAX_MS + 1
"""In place of the time of images that observed nothing."""
VOXEL_M = 0.25
"""Side of a voxel."""
HEIGHT_M = 1.5
"""Height of the map, half above and half below the drone, at least."""
MARGIN_M = 2.0
"""The map moves when the drone is this far from its middle."""
NEAR_M = 4.0
"""Distance within which an image that shows nothing counts."""
DRONE_RADIUS_M = 1.0
"""Surfaces within this distance of another drone belong to that drone."""
MAX_ERROR_M = 0.5
"""Surfaces so far away that their range is less exact than this are not recorded; nothing behind them is free."""


class MapConfig(Model):
    """Size of the map, and how long images must look to decide about a voxel; see `MAX_IMAGE_S`."""

    reach_m: float = Field(default=10.0, gt=2, le=100)
    """Distance from the drone to the sides of the map, at least."""
    passed_s: float = Field(default=0.3, gt=0, le=10)
    """Time for which images must see through a voxel until it is free: three images of a camera of 10 Hz."""
    vain_s: float = Field(default=0.5, gt=0, le=10)
    """Time without a break for which images must have a nearby voxel in view and show nothing of it, until the voxel
    counts as unobservable: looking longer does not help. A free voxel then stops being free, unless images had seen
    through it for a longer time than that."""
    memory_s: float = Field(default=60.0, gt=0)
    """Time for which free space is remembered. Odometry drifts, and things move: less of it forgets both."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of layers, rows and columns; paths need even numbers of the latter."""
        side = 4 * int(np.ceil((self.reach_m + MARGIN_M) / VOXEL_M / 2))
        # The middle of the map is a whole number of layers, which may be half a layer away from the drone.
        return 2 * int(np.ceil(HEIGHT_M / 2 / VOXEL_M + 0.5)), side, side


class VoxelMap:
    """Collects the evidence of the images of one camera, whose cells are those of `sensor`."""

    def __init__(self, config: MapConfig, sensor: InverseSensorModel) -> None:
        self._config = c = config
        self._sensor, self._frustum = sensor, Frustum(sensor.camera)
        self._max_surface_m = sensor.range_of_error(MAX_ERROR_M)
        self._passed_from_ms, self._vain_from_ms = (round(1e3 * time_s) for time_s in (c.passed_s, c.vain_s))
        self._updated_s, self._counted_s = -np.inf, 0.0
        """Time of the last image, and for how long all images together count [s]."""
        self._passed_ms = np.zeros(c.shape, np.uint16)
        """Time for which images saw through each voxel since it was occupied last."""
        self._missed_s = np.zeros(c.shape, np.float32)
        """Time of the last miss [s]."""
        self._occupancy_ms = np.zeros(c.shape, np.uint16)
        """Hits less misses; see `HIT`."""
        self._unobserved_ms = np.zeros(c.shape, np.uint16)
        """Time for which images had the voxel in view from nearby, and neither hit nor missed it since; or
        `BLACKLISTED_MS`."""
        self._half = np.array(c.shape[::-1]) // 2
        """Numbers of voxels (x, y, z) from the corner of the map to its middle."""
        self._moves_from = np.array([MARGIN_M, MARGIN_M, VOXEL_M]) / VOXEL_M
        """Distance (x, y, z) of the drone from the middle from which on the map moves, in voxels."""
        self._origin: Indices | None = None
        """Corner of the first voxel (x, y, z), in voxels."""

    @property
    def origin_m(self) -> FloatArray:
        """Corner of the map (x, y, z), shape (3,)."""
        assert self._origin is not None, "start comes first"
        return np.asarray(self._origin * VOXEL_M)

    def start(self, at_m: FloatArray, radius_m: float, time_s: float) -> None:
        """Begin the map around a drone, within a radius of which all counts as free."""
        self._follow(at_m)
        self.take(at_m, radius_m, HEIGHT_M / 2, time_s)

    def take(self, at_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Make the upright cylinder free that the drone itself takes: it is there, so that a surface was an error.

        Args:
            at_m: Middle of the cylinder, in the frame of the odometry, shape (3,).
            radius_m: Radius of the cylinder.
            half_height_m: Height of the cylinder above and below its middle.
            time_s: Time from which on the free space is remembered.
        """
        self._make_free(self._in_cylinders(at_m[None], radius_m, half_height_m), time_s)

    def mark_free(self, centers_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Make the upright cylinders free that other drones are believed to take.

        A confirmed surface stays: the belief may be wrong by more than the width of a drone.

        Args:
            centers_m: Middle of each cylinder, in the frame of the odometry, shape (n, 3).
            radius_m: Radius of the cylinders.
            half_height_m: Height of the cylinders above and below their middles.
            time_s: Time from which on the free space is remembered.
        """
        inside = self._in_cylinders(centers_m, radius_m, half_height_m)
        is_open = self._occupancy_ms[inside] < OCCUPIED_MS
        self._make_free(tuple(along[is_open] for along in inside), time_s)

    def blacklist(self, centers_m: FloatArray, radius_m: float, half_height_m: float, time_s: float) -> None:
        """Make what is unknown in upright cylinders unobservable, because looking did not help.

        What was unobservable already is blacklisted, until an image shows it; cylinders that overlap count once.

        Args:
            centers_m: Middle of each cylinder, in the frame of the odometry, shape (n, 3).
            radius_m: Radius of the cylinders.
            half_height_m: Height of the cylinders above and below their middles.
            time_s: Time at which free space must still be remembered, or else it is unknown.
        """
        inside = self._in_cylinders(centers_m, radius_m, half_height_m)
        before_ms = self._unobserved_ms[inside]
        worse_ms = np.where(before_ms >= self._vain_from_ms, BLACKLISTED_MS, self._vain_from_ms)
        self._unobserved_ms[inside] = np.where(self._is_free(inside, time_s), before_ms, worse_ms)

    def is_column_free(self, at_m: FloatArray, low_m: float, high_m: float, time_s: float) -> bool:
        """Return whether the column of voxels at a position and the eight around it are free between two heights.

        What the map does not reach is not free.

        Args:
            at_m: Position in the frame of the odometry, shape (3,); its height does not count.
            low_m: Lower height, in the same frame.
            high_m: Upper height.
            time_s: Time at which free space must still be remembered.
        """
        col, row, _ = np.floor((at_m - self.origin_m) / VOXEL_M).astype(int).tolist()
        around = self.layer(low_m, high_m, time_s, np.s_[row - 1 : row + 2, col - 1 : col + 2])
        return min(row, col) >= 1 and around.shape == (3, 3) and bool((around == FREE).all())

    def update(self, evidence: Evidence, T_odom_cam: FloatArray, drones_m: FloatArray, time_s: float) -> None:
        """Add the evidence of an image; surfaces near the other drones are these drones.

        Those surfaces, and surfaces that are too far to be exact, are no hits, but hide what lies behind them.

        Args:
            evidence: What the image proves, by the sensor of this map.
            T_odom_cam: Pose of the camera by the odometry, shape (4, 4).
            drones_m: Positions of the other drones in the image, in the frame of the odometry, shape (n, 3).
            time_s: Time of the image.
        """
        self._follow(T_odom_cam[:3, 3])
        image_ms = self._counted_ms(time_s)
        (free_m, surface_m), half_m = evidence, np.float32(VOXEL_M / 2)
        is_exact, points_m = self._surfaces(surface_m, T_odom_cam, drones_m)
        voxel, cell, squared_m2 = self._in_view(T_odom_cam, max(NEAR_M, float(free_m.max())))
        free_m2, from_m2, to_m2 = (
            np.square(np.maximum(range_m, 0)).ravel()[cell]
            for range_m in (free_m - half_m, surface_m - half_m, surface_m + half_m)
        )
        is_miss, is_before = squared_m2 <= free_m2, squared_m2 < from_m2
        is_hit = ~(is_miss | is_before) & (squared_m2 <= to_m2) & is_exact.ravel()[cell]
        # A surface may be thin, and lie beside the middle of its voxel: that is hit, whatever the image shows there.
        hit = self._voxels_at(points_m)
        is_other = np.ones(self._passed_ms.size, np.bool_)
        is_other[hit] = False
        is_other = is_other[voxel]
        self._add_misses(voxel[is_miss & is_other], image_ms, time_s)
        self._add_unobserved(voxel[~is_miss & is_before & (squared_m2 < NEAR_M**2) & is_other], image_ms)
        self._add_hits(np.concatenate([hit, voxel[is_hit & is_other]]), image_ms)

    def layer(self, low_m: float, high_m: float, time_s: float, columns: Any = np.s_[:, :]) -> Bytes:
        """Return the worst state of each column of voxels between two heights, shape (rows along y, columns along x).

        What the map does not reach is unknown.

        Args:
            low_m: Lower height, in the frame of the odometry.
            high_m: Upper height.
            time_s: Time at which free space must still be remembered.
            columns: Slices of the rows and the columns that count; by default all.
        """
        bottom_m = float(self.origin_m[2])
        first, last = floor((low_m - bottom_m) / VOXEL_M), ceil((high_m - bottom_m) / VOXEL_M)
        voxels = np.s_[max(first, 0) : last, *columns]
        vain_ms = self._unobserved_ms[voxels]
        # From unknown over unobservable to blacklisted, the numbers of the states count the conditions that hold.
        state = np.uint8(UNKNOWN) + (vain_ms >= self._vain_from_ms) + (vain_ms == BLACKLISTED_MS)
        state[self._is_free(voxels, time_s)] = FREE
        state[self._occupancy_ms[voxels] >= OCCUPIED_MS] = OCCUPIED
        reaches = first >= 0 and last <= len(self._passed_ms)
        return np.asarray(state.max(axis=0, initial=FREE if reaches else UNKNOWN), np.uint8)

    def _is_free(self, voxels: Any, time_s: float) -> npt.NDArray[np.bool_]:
        """Return whether images saw through voxels, by their index, for long enough and not too long ago."""
        is_recent = self._missed_s[voxels] >= time_s - self._config.memory_s
        return np.asarray((self._passed_ms[voxels] >= self._passed_from_ms) & is_recent)

    def _make_free(self, voxels: tuple[Indices, ...], time_s: float) -> None:
        """Make voxels free, by their indices along each axis, as if images had seen through them for long."""
        self._passed_ms[voxels] = MAX_MS
        self._missed_s[voxels] = time_s
        self._occupancy_ms[voxels] = self._unobserved_ms[voxels] = 0

    def _in_view(self, T_map_cam: FloatArray, farthest_m: float) -> tuple[Indices, Indices, FloatVector]:
        """Find the voxels whose middle is in view.

        Columns of voxels wholly to the left or to the right of the view, or beyond the range, are left out first.

        Args:
            T_map_cam: Pose of the camera, shape (4, 4).
            farthest_m: Range, in the horizontal plane.

        Returns:
            Of each voxel in view, shape (n,): its index, that of its cell in the image, and its squared range [m^2].
        """
        axes, camera_m = T_map_cam[:3, :3].T.astype(np.float32), T_map_cam[:3, 3].astype(np.float32)
        east_m, north_m, up_m, ends_m = self._middles(camera_m)
        level_m2 = east_m * east_m + north_m * north_m
        # Each column is a line through its point at the height of the camera, in the frame of the camera.
        x_m, y_m, z_m = (axis[0] * east_m + axis[1] * north_m for axis in axes)
        upwards = axes[:, 2]
        is_near = level_m2 <= np.float32(farthest_m**2)
        column = np.flatnonzero(is_near & self._frustum.may_show(x_m, z_m, upwards, ends_m))
        x_m, y_m, z_m = (
            on_axis.ravel()[column, None] + up * up_m for on_axis, up in zip((x_m, y_m, z_m), upwards, strict=True)
        )
        u, v, is_in_view = self._frustum.project(x_m, y_m, z_m)
        seen = np.flatnonzero(is_in_view)
        _, rows, cols = self._passed_ms.shape
        voxel = seen % len(up_m) * (rows * cols) + column[seen // len(up_m)]
        squared_m2 = level_m2.ravel()[column, None] + up_m * up_m
        return voxel, self._sensor.cells(v.ravel()[seen], u.ravel()[seen]), squared_m2.ravel()[seen]

    def _middles(self, from_m: FloatVector) -> tuple[FloatVector, FloatVector, FloatVector, FloatVector]:
        """Return the middles of the voxels along x (cols,), y (rows, 1) and z (layers,), from a position, shape (3,).

        The last are bottom and top of the map.
        """
        corner_m, side_m = self.origin_m.astype(np.float32) - from_m, np.float32(VOXEL_M)
        n_voxels = self._passed_ms.shape[::-1]
        east_m, north_m, up_m = (
            first_m + side_m * (np.arange(n, dtype=np.float32) + np.float32(0.5))
            for first_m, n in zip(corner_m, n_voxels, strict=True)
        )
        return east_m, north_m[:, None], up_m, corner_m[2] + side_m * np.array([0, n_voxels[2]], np.float32)

    def _surfaces(
        self, surface_m: FloatImage, T_odom_cam: FloatArray, drones_m: FloatArray
    ) -> tuple[MaskImage, FloatArray]:
        """Return which cells show a surface that is exact and no drone, and where these surfaces are, shape (n, 3)."""
        is_exact = surface_m < self._max_surface_m
        rays = matmul(self._sensor.rays_cam[is_exact], T_odom_cam[:3, :3].T)
        points_m = surface_m[is_exact, None] * rays + T_odom_cam[:3, 3]
        apart_m2 = ((points_m[:, None] - drones_m) ** 2).sum(axis=2)
        is_surface = (apart_m2 > DRONE_RADIUS_M**2).all(axis=1)
        is_exact[is_exact] = is_surface
        return is_exact, points_m[is_surface]

    def _voxels_at(self, points_m: FloatArray) -> Indices:
        """Return the indices of the voxels that contain points, shape (n, 3), without those beside the map."""
        voxel = np.floor((points_m - self.origin_m) / VOXEL_M).astype(np.int64)[:, ::-1]
        inside = ((voxel >= 0) & (voxel < self._passed_ms.shape)).all(axis=1)
        return np.asarray(np.ravel_multi_index(tuple(voxel[inside].T), self._passed_ms.shape))

    def _counted_ms(self, time_s: float) -> int:
        """Return for how long the image of a time counts; what rounding leaves out of one, the next ones make up."""
        before_ms = round(1e3 * self._counted_s)
        self._counted_s += min(time_s - self._updated_s, MAX_IMAGE_S)
        self._updated_s = time_s
        return round(1e3 * self._counted_s) - before_ms

    def _add_misses(self, voxel: Indices, image_ms: int, time_s: float) -> None:
        """Add an image that saw through voxels; misses longer ago than the memory do not count any more."""
        passed_ms, missed_s, occupancy_ms = self._passed_ms.ravel(), self._missed_s.ravel(), self._occupancy_ms.ravel()
        is_occupied = occupancy_ms[voxel] >= OCCUPIED_MS
        kept_ms = np.where(missed_s[voxel] >= time_s - self._config.memory_s, passed_ms[voxel], 0)
        passed_ms[voxel] = np.minimum(kept_ms + image_ms * ~is_occupied, MAX_MS)
        missed_s[voxel] = time_s
        occupancy_ms[voxel] = np.maximum(occupancy_ms[voxel], image_ms) - image_ms
        self._unobserved_ms.ravel()[voxel] = 0

    def _add_unobserved(self, voxel: Indices, image_ms: int) -> None:
        """Add an image that had voxels in view from nearby, and neither hit nor missed them.

        A free voxel stops being free once images have shown nothing of it for as long as they had seen through it.
        """
        unobserved_ms, passed_ms = self._unobserved_ms.ravel(), self._passed_ms.ravel()
        before_ms = unobserved_ms[voxel]
        vain_ms = np.maximum(np.minimum(before_ms + image_ms, MAX_MS), before_ms)
        unobserved_ms[voxel] = vain_ms
        passed_ms[voxel] *= vain_ms < np.maximum(passed_ms[voxel], self._vain_from_ms)

    def _add_hits(self, voxel: Indices, image_ms: int) -> None:
        """Add an image that showed a surface in voxels."""
        occupancy_ms = np.minimum(self._occupancy_ms.ravel()[voxel] + HIT * image_ms, MAX_OCCUPANCY_MS)
        self._occupancy_ms.ravel()[voxel] = occupancy_ms
        self._passed_ms.ravel()[voxel] *= occupancy_ms < OCCUPIED_MS
        self._unobserved_ms.ravel()[voxel] = 0

    def _in_cylinders(self, centers_m: FloatArray, radius_m: float, half_height_m: float) -> tuple[Indices, ...]:
        """Return the voxels of upright cylinders around centres of shape (n, 3).

        In x and y the middle of a voxel must be inside; in z it is enough that the cylinder touches the layer.
        """
        window = _window(ceil(half_height_m / VOXEL_M), *[ceil(radius_m / VOXEL_M)] * 2)
        center = centers_m[:, None, ::-1] - self.origin_m[::-1]
        voxel = np.floor(center / VOXEL_M).astype(np.int64) + window
        z_m, y_m, x_m = np.moveaxis((voxel + 0.5) * VOXEL_M - center, -1, 0)
        inside = (x_m * x_m + y_m * y_m <= radius_m**2) & (np.abs(z_m) < half_height_m + VOXEL_M / 2)
        inside &= ((voxel >= 0) & (voxel < self._passed_ms.shape)).all(axis=-1)
        return tuple(voxel[inside].T)

    def _follow(self, at_m: FloatArray) -> None:
        """Move the map, by whole voxels, so that a position is near its middle."""
        wanted = np.round(at_m / VOXEL_M).astype(np.int64) - self._half
        if self._origin is not None:
            moved = wanted - self._origin
            if (np.abs(moved) < self._moves_from).all():
                return
            for values in (self._passed_ms, self._missed_s, self._occupancy_ms, self._unobserved_ms):
                values[...] = _shifted(values, moved[::-1])
        self._origin = wanted


@cache
def _window(*reach: int) -> Indices:
    """Return the offsets up to a reach along each axis, shape (n, 3)."""
    return np.moveaxis(np.indices([2 * each + 1 for each in reach]), 0, -1).reshape(-1, len(reach)) - reach


def _shifted(array: npt.NDArray[Any], by: npt.NDArray[np.int64]) -> npt.NDArray[Any]:
    """Return an array whose content moved against its axes, filled up with zeros."""
    by = np.clip(by, np.negative(array.shape), array.shape)
    first = np.maximum(by, 0)
    padded = np.pad(array, np.stack([first - by, first], axis=1))
    return padded[tuple(slice(start, start + n) for start, n in zip(first, array.shape, strict=True))]
