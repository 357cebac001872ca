"""What tests ask of a voxel grid, and its projection by NumPy."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from voxdepth.geometry import PointArray
from voxdepth.paper.voxels import OccupiedVoxels, VoxelConfig, VoxelGrid, Words
from voxdepth.types import FloatImage, Intrinsics, MaskImage

Cells = npt.NDArray[np.int32]


def integrate_points(grid: VoxelGrid, points: PointArray) -> None:
    """OR the voxels of points [m], shape (N, 3), into the grid. Points outside of it, and NaN, are left out."""
    set_bits(cells_of_points(points, grid.config), grid.words)


def occupied_centres(grid: VoxelGrid) -> PointArray:
    """Centres of all occupied voxels [m], shape (N, 3), float32, the farthest last."""
    return OccupiedVoxels.of(grid.words, grid.config).centres_m


def cells_of_points(points: PointArray, config: VoxelConfig) -> Cells:
    """Number of each point's cell, shape (N,), int32; -1 beside the grid."""
    T = config.T_cells_m.astype(np.float32)
    coordinates = [points[:, k] * T[k, k] + T[k, 3] for k in range(3)]
    return _numbers(coordinates, np.ones(len(points), np.bool_), config)


def _numbers(coordinates: Sequence[npt.NDArray[np.float32]], inside: MaskImage, config: VoxelConfig) -> Cells:
    """Number of each cell by its coordinates along x, y and z; -1 beside the grid and where `inside` is False."""
    for coordinate, n in zip(coordinates, config.shape, strict=True):
        inside = inside & (coordinate >= 0) & (coordinate < n)
    x, y, z = (np.where(inside, coordinate, 0).astype(np.int32) for coordinate in coordinates)
    nx, ny, _ = config.shape
    return np.where(inside, (z * ny + y) * nx + x, -1)


def set_bits(cells: Cells, words: Words) -> None:
    """Set the bits of numbered cells; -1 is left out."""
    inside = cells[cells >= 0]
    np.bitwise_or.at(words, inside >> 5, np.uint32(1) << (inside & 31).astype(np.uint32))


def project_nearest(points: PointArray, intrinsics: Intrinsics) -> FloatImage:
    """Depth image [m], shape (H, W), float32, of points (N, 3) [m] in the camera frame; 0 where none falls.

    A point takes the one pixel that its projection rounds to. With the centres of voxels, the twin of the kernel.
    """
    depth_m = np.full(intrinsics.shape, np.inf, np.float32)
    x, y, z = points[points[:, 2] > 0].T
    half = np.float32(0.5)
    col = np.floor(x / z * np.float32(intrinsics.fx_px) + np.float32(intrinsics.cx_px) + half)
    row = np.floor(y / z * np.float32(intrinsics.fy_px) + np.float32(intrinsics.cy_px) + half)
    inside = (col >= 0) & (col < intrinsics.width_px) & (row >= 0) & (row < intrinsics.height_px)
    np.minimum.at(depth_m, (row[inside].astype(np.intp), col[inside].astype(np.intp)), z[inside])
    depth_m[np.isinf(depth_m)] = 0
    return depth_m
