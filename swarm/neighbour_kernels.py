"""Compiled loops of the perception of other drones: over the pixels that show one, and over the drones."""

import numpy as np
import numpy.typing as npt

from voxdepth.compiled import compiled
from voxdepth.types import FloatArray, FloatImage

Numbers = npt.NDArray[np.int64]
MaskVector = npt.NDArray[np.bool_]
DRONE_MASK_RADIUS_M = 1.0
"""Surfaces within this distance of another drone belong to that drone."""


@compiled("b1(f8[::1], f8[:, ::1])")
def is_of_drone(point_m: FloatArray, drones_m: FloatArray) -> bool:
    """Return whether a point of a surface, shape (3,), belongs to one of the drones, shape (n, 3)."""
    for k in range(len(drones_m)):
        squared = 0.0
        for d in range(3):
            squared += (point_m[d] - drones_m[k, d]) ** 2
        if squared <= DRONE_MASK_RADIUS_M**2:
            return True
    return False


@compiled("void(f8[:, ::1], f8[:, ::1], b1[::1])")
def mark_drone_points(
    points_m: FloatArray,
    drones_m: FloatArray,
    # output
    is_drone: MaskVector,
) -> None:
    """Mark the points of surfaces, shape (n, 3), that belong to one of the drones, shape (m, 3)."""
    for n in range(len(points_m)):
        is_drone[n] = is_of_drone(points_m[n], drones_m)


@compiled("void(i4[:, ::1], f4[:, ::1], i8[::1], i8[::1], f8[:, ::1], f8[::1])")
def measure_drones(
    segment_id: npt.NDArray[np.int32],
    depth_m: FloatImage,
    drone_ids: Numbers,
    # output
    n_pixels: Numbers,
    center_px: FloatArray,
    median_m: FloatArray,
) -> None:
    """Measure the pixels of each drone; ids from the first of the ascending `drone_ids` on are drones.

    The results are the number of the pixels, their mean (column, row), and the median of their depths, 0 without depth.
    """
    n_drones, n_depths = len(drone_ids), np.zeros(len(drone_ids), np.int64)
    n_pixels[:] = 0
    center_px[:] = 0
    for row in range(segment_id.shape[0]):
        for col in range(segment_id.shape[1]):
            if segment_id[row, col] >= drone_ids[0]:
                drone = np.searchsorted(drone_ids, segment_id[row, col])
                n_pixels[drone] += 1
                center_px[drone, 0] += col
                center_px[drone, 1] += row
                n_depths[drone] += depth_m[row, col] > 0
    ends = np.cumsum(n_depths)
    depths_m, filled = np.empty(ends[-1]), ends - n_depths
    for row in range(segment_id.shape[0] if len(depths_m) else 0):
        for col in range(segment_id.shape[1]):
            if segment_id[row, col] >= drone_ids[0] and depth_m[row, col] > 0:
                drone = np.searchsorted(drone_ids, segment_id[row, col])
                depths_m[filled[drone]] = depth_m[row, col]
                filled[drone] += 1
    for drone in range(n_drones):
        own_m = depths_m[ends[drone] - n_depths[drone] : ends[drone]]
        center_px[drone] /= max(n_pixels[drone], 1)
        median_m[drone] = np.median(own_m) if len(own_m) else 0.0


@compiled("b1(f8[::1], f8[:, ::1], f8, f8, f8)")
def is_in_view(
    position_m: FloatArray, T_world_cam: FloatArray, slope_x: float, slope_y: float, max_range_m: float
) -> bool:
    """Return whether a position lies in the field of view, which ends at the slopes, and within a range."""
    offset_m = position_m - T_world_cam[:3, 3]
    x = (offset_m * T_world_cam[:3, 0]).sum()
    y = (offset_m * T_world_cam[:3, 1]).sum()
    z = (offset_m * T_world_cam[:3, 2]).sum()
    in_cone = z > 0 and abs(x) <= slope_x * z and abs(y) <= slope_y * z
    return bool(in_cone and x * x + y * y + z * z <= max_range_m**2)


@compiled(
    "i8("
    + "i8[::1], f8[:, ::1], f8[:, ::1], f8[::1], f8[:, ::1], f8[:, ::1], "
    + "f8, " * 6
    + "i8[::1], f8[:, ::1], f8[:, ::1])"
)
def combine(
    heard: Numbers,
    heard_position_m: FloatArray,
    heard_velocity_m_s: FloatArray,
    seen_at_s: FloatArray,
    seen_position_m: FloatArray,
    T_world_cam: FloatArray,
    time_s: float,
    memory_s: float,
    slope_x: float,
    slope_y: float,
    max_range_m: float,
    agreed_m: float,
    # output
    drones: Numbers,
    position_m: FloatArray,
    velocity_m_s: FloatArray,
) -> int:
    """Choose between camera and radio for every drone; return the number of those that are known.

    A drone in view is where the camera found it, unless the radio says that it is farther than `agreed_m` from there:
    its depth may be wrong. The heard drones come first, then those that are seen and not heard.
    """
    n, unheard = 0, time_s - seen_at_s <= memory_s
    for k in range(len(heard)):
        drone, age_s = heard[k], time_s - seen_at_s[heard[k]]
        unheard[drone] = False
        drones[n], velocity_m_s[n], position_m[n] = drone, heard_velocity_m_s[k], heard_position_m[k]
        if age_s <= memory_s and is_in_view(heard_position_m[k], T_world_cam, slope_x, slope_y, max_range_m):
            followed_m = seen_position_m[drone] + age_s * heard_velocity_m_s[k]
            if ((followed_m - heard_position_m[k]) ** 2).sum() <= agreed_m**2:
                position_m[n] = followed_m
        n += 1
    for drone in range(len(unheard)):
        if unheard[drone]:
            drones[n], position_m[n], velocity_m_s[n] = drone, seen_position_m[drone], 0
            n += 1
    return n
