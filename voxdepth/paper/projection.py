"""Projection of a point cloud to a sparse depth image with a z-buffer: the nearest point wins."""

import numpy as np
import warp as wp

from ..geometry import PointArray
from ..types import FloatImage, Intrinsics
from . import kernels
from .voxels import VoxelGrid


def project_voxels(grid: VoxelGrid, intrinsics: Intrinsics) -> FloatImage:
    """Depth image [m], shape (H, W), float32, of the centres of a grid's voxels; 0 where none falls.

    The same as `project_nearest(grid.occupied_centres(), intrinsics)`, without making a list of them.
    """
    depth_m = np.full(intrinsics.shape, np.inf, np.float32)
    occupied = np.flatnonzero(grid.words != 0).astype(np.int32)
    if occupied.size:
        words = [kernels.view(occupied, wp.int32), kernels.view(grid.words, wp.uint32)]
        wp.launch(
            kernels.splat_listed_voxels,
            len(occupied),
            inputs=[*words, *kernels.cells(grid.config.cell_m, grid.config.shape), *kernels.lens(intrinsics)],
            outputs=[kernels.view(depth_m, wp.float32)],
            device="cpu",
        )
    depth_m[np.isinf(depth_m)] = 0
    return depth_m


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
