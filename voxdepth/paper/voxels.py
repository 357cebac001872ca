"""Boolean voxel grid, packed in bits, and its projection to a depth image: paper, Algorithm 1 and Eq. voxelor."""

from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
import warp as wp
from pydantic import Field, model_validator

from ..devices import load_kernels
from ..geometry import RayMap
from ..model import Model
from ..types import FloatArray, FloatImage, Intrinsics
from . import kernels

Words = npt.NDArray[np.uint32]
Cells = npt.NDArray[np.int32]

TILE_PX = 40_000
"""Pixels per tile: few enough that intermediate results stay in the cache."""


class VoxelConfig(Model):
    """Cells and extents of the grid. Smaller cells keep more detail and need more memory."""

    cell_m: tuple[float, float, float] = Field(default=(0.1, 0.1, 0.065), strict=False)
    """Size of a voxel along x, y and z of the camera [m]. Paper: 0.1, 0.1, 0.065."""
    half_width_m: float = Field(default=40.0, gt=0)
    """Extent to the left and to the right of the optical axis [m]."""
    half_height_m: float = Field(default=16.0, gt=0)
    """Extent above and below the optical axis [m]."""
    depth_m: float = Field(default=41.0, gt=0)
    """Extent along the optical axis [m]."""

    @model_validator(mode="after")
    def _check(self) -> "VoxelConfig":
        if min(self.cell_m) <= 0:
            raise ValueError(f"cell sizes must be positive, got {self.cell_m} m")
        if np.prod(self.shape, dtype=np.float64) >= 2**31:
            raise ValueError(f"a grid of {self.shape} cells has more than 2^31: enlarge cell_m or shrink the extents")
        return self

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of cells along x, y and z."""
        x, y, z = np.ceil(np.array([self.half_width_m, self.half_height_m, self.depth_m]) / self.cell_m)
        return 2 * int(x), 2 * int(y), int(z)

    @property
    def n_words(self) -> int:
        """Number of 32-bit words that hold the grid."""
        return -(-int(np.prod(self.shape, dtype=np.int64)) // 32)

    @property
    def T_cells_m(self) -> FloatArray:  # noqa: N802
        """Affine map from metres in the camera frame to cells, whose floor is the index of a cell; shape (4, 4)."""
        nx, ny, _ = self.shape
        T = np.diag([*(1 / np.array(self.cell_m)), 1.0])
        T[:2, 3] = nx // 2, ny // 2
        return T


class VoxelGrid:
    """A set of occupied voxels in the camera frame. Adding a cloud is the Boolean OR of the paper.

    Cells are numbered with x fastest and z slowest, so that neighbouring pixels of a surface share words of memory.
    """

    def __init__(self, config: VoxelConfig) -> None:
        self.config = config
        load_kernels(kernels, "cpu")
        self.words: Words = np.zeros(config.n_words, np.uint32)

    def clear(self) -> None:
        """Empty the grid."""
        self.words.fill(0)

    def integrate(self, depth_m: FloatImage, intrinsics: Intrinsics, T_grid_cam: FloatArray) -> None:
        """OR the voxels of all valid pixels of a depth image into the grid: paper, Algorithm 1.

        `T_grid_cam`, shape (4, 4), is the pose of its camera in the frame of the grid.
        """
        rays = RayMap.of(intrinsics, self.config.T_cells_m @ T_grid_cam)
        set_bits(cells_of_image(depth_m, rays, self.config).ravel(), self.words)


def cells_of_image(depth_m: FloatImage, rays: RayMap, config: VoxelConfig) -> Cells:
    """Number of each pixel's cell, shape (H, W), int32; -1 where the pixel is invalid or falls outside the grid."""
    cells = np.empty(depth_m.shape, np.int32)
    tile_rows = max(1, TILE_PX // depth_m.shape[1])
    for top in range(0, len(depth_m), tile_rows):
        rows = slice(top, top + tile_rows)
        z = depth_m[rows]
        coordinates = (rays.coordinate(k, rows, z) for k in (2, 1, 0))
        cells[rows] = _cell_numbers(coordinates, z > 0, config)
    return cells


def _cell_numbers(coordinates: Iterable[FloatImage], inside: npt.NDArray[np.bool_], config: VoxelConfig) -> Cells:
    """Numbers of the cells with coordinates along z, y and x; -1 unless `inside`, which is narrowed to the grid."""
    number = np.zeros(inside.shape, np.int32)
    with np.errstate(invalid="ignore", over="ignore"):  # of coordinates that are not inside
        for coordinate, n in zip(coordinates, reversed(config.shape), strict=True):
            if not (coordinate.min(initial=0) >= 0 and coordinate.max(initial=0) < n):  # most tiles are all inside
                inside &= (coordinate >= 0) & (coordinate < n)
            number *= np.int32(n)
            number += coordinate.astype(np.int32)
    number |= inside.astype(np.int32) - 1  # all bits of -1 where outside; several times faster than a masked copy
    return number


def set_bits(cells: Cells, words: Words) -> None:
    """Set the bits of cells by their numbers; -1 is left out."""
    if cells.size:
        wp.launch(
            kernels.set_bits,
            cells.size,
            inputs=[kernels.view(cells, wp.int32)],
            outputs=[kernels.view(words, wp.uint32)],
            device="cpu",
        )


def project_voxels(grid: VoxelGrid, intrinsics: Intrinsics) -> FloatImage:
    """Depth image [m], shape (H, W), float32, of the centres of a grid's voxels; 0 where none falls."""
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
