"""Boolean voxel grid, packed in bits, and its projection to a depth image: paper, Algorithm 1 and Eq. voxelor."""

from dataclasses import dataclass
from math import prod
from typing import Self

import numpy as np
import numpy.typing as npt
from numba import float32, int64, uint32, void
from numba.types import UniTuple
from pydantic import Field, model_validator

from ..arithmetic import matmul
from ..compiled import FLOAT_IMAGE, READABLE_IMAGE, compiled
from ..geometry import PointArray, RayMap
from ..model import Model
from ..types import FloatArray, FloatImage, Intrinsics

Words = npt.NDArray[np.uint32]
WORDS = uint32[::1]
SMALLEST_CELL_M = 0.001
LARGEST_EXTENT_M = 1_000_000.0


class VoxelConfig(Model):
    """Cells and extents of the grid. Smaller cells keep more detail and need more memory."""

    cell_m: tuple[float, float, float] = Field(default=(0.1, 0.1, 0.065), strict=False)
    """Size of a voxel along x, y and z of the camera [m]. From the authors' code: 0.1, 0.1, 0.065."""
    half_width_m: float = Field(default=40.0, gt=0, le=LARGEST_EXTENT_M)
    """Extent to the left and to the right of the optical axis [m]."""
    half_height_m: float = Field(default=16.0, gt=0, le=LARGEST_EXTENT_M)
    """Extent above and below the optical axis [m]."""
    depth_m: float = Field(default=41.0, gt=0, le=LARGEST_EXTENT_M)
    """Extent along the optical axis [m]."""

    @model_validator(mode="after")
    def _check(self) -> "VoxelConfig":
        if min(self.cell_m) < SMALLEST_CELL_M:
            raise ValueError(f"cell sizes must be at least {SMALLEST_CELL_M} m, got {self.cell_m} m")
        if prod(self.shape) >= 2**31:
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
        return -(-prod(self.shape) // 32)

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

    def __init__(self, config: VoxelConfig, intrinsics: Intrinsics) -> None:
        self.config = config
        self.words: Words = np.zeros(config.n_words, np.uint32)
        self._intrinsics = intrinsics

    def clear(self) -> None:
        """Empty the grid."""
        self.words.fill(0)

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """OR the voxels of all valid pixels of a depth image [m], shape (H, W), into the grid: paper, Algorithm 1.

        `T_grid_cam`, shape (4, 4), is the pose of its camera in the frame of the grid.
        """
        rays = RayMap.of(self._intrinsics, matmul(self.config.T_cells_m, T_grid_cam))
        _mark(np.ascontiguousarray(depth_m), rays.rows, rays.cols, rays.offset, self.config.shape, self.words)

    def project(self) -> FloatImage:
        """Return the depth [m], shape (H, W), float32, of the voxels' centres as the camera of the grid sees them.

        It is 0 where no centre falls.
        """
        depth_m, camera = np.zeros(self._intrinsics.shape, np.float32), self._intrinsics
        focal_px, centre_px = (camera.fx_px, camera.fy_px), (camera.cx_px, camera.cy_px)
        _draw(self.words, self.config.cell_m, self.config.shape, focal_px, centre_px, depth_m)
        return depth_m

    def occupied(self) -> "OccupiedVoxels":
        """Return the voxels of the grid as they are now."""
        return OccupiedVoxels.of(self.words, self.config)


@compiled(void(READABLE_IMAGE, FLOAT_IMAGE, FLOAT_IMAGE, float32[::1], UniTuple(int64, 3), WORDS))
def _mark(
    depth_m: FloatImage,
    rows: FloatImage,
    cols: FloatImage,
    offset: npt.NDArray[np.float32],
    shape: tuple[int, int, int],
    # output
    words: Words,
) -> None:
    """Set the bit of the cell of each valid pixel.

    Args:
        depth_m: Measured depth, shape (H, W); 0 = invalid.
        rows: What each row adds per metre of depth to the three coordinates in cells, shape (3, H); see `RayMap`.
        cols: What each column adds, shape (3, W).
        offset: The coordinates of the camera in cells, shape (3,).
        shape: Number of cells along x, y and z.
        words: Bits of the grid, 32 cells each, x fastest and z slowest, shape (`VoxelConfig.n_words`,); changed in
            place.
    """
    for row in range(depth_m.shape[0]):
        for col in range(depth_m.shape[1]):
            z_m = depth_m[row, col]
            x = (rows[0, row] + cols[0, col]) * z_m + offset[0]
            y = (rows[1, row] + cols[1, col]) * z_m + offset[1]
            z = (rows[2, row] + cols[2, col]) * z_m + offset[2]
            is_inside = (x >= 0) & (x < shape[0]) & (y >= 0) & (y < shape[1]) & (z >= 0) & (z < shape[2])
            if (z_m > 0) & is_inside:
                cell = (int64(z) * shape[1] + int64(y)) * shape[0] + int64(x)
                words[cell >> 5] |= uint32(1) << uint32(cell & 31)


@dataclass(frozen=True, eq=False)
class OccupiedVoxels:
    """The occupied voxels of a grid at one time, as its words that are not zero."""

    config: VoxelConfig
    at: npt.NDArray[np.intp]
    """Index of each of those words."""
    words: Words

    @classmethod
    def of(cls, words: Words, config: VoxelConfig) -> Self:
        """Return the occupied voxels of a grid with these words, as a copy."""
        at = np.flatnonzero(words != 0)  # four times as fast as without the comparison
        return cls(config, at, words[at])

    @property
    def centres_m(self) -> PointArray:
        """Centres of the voxels [m] in the frame of the grid, shape (N, 3), float32, the farthest last."""
        set_at = np.flatnonzero(np.unpackbits(self.words.view(np.uint8), bitorder="little"))
        nx, ny, _ = self.config.shape
        row, x = np.divmod(self.at[set_at >> 5] * 32 + (set_at & 31), nx)
        z, y = np.divmod(row, ny)
        cells = np.column_stack([x - nx // 2, y - ny // 2, z]).astype(np.float32)
        centres_m: PointArray = (cells + np.float32(0.5)) * np.array(self.config.cell_m, np.float32)
        return centres_m


@compiled(
    void(WORDS, UniTuple(float32, 3), UniTuple(int64, 3), UniTuple(float32, 2), UniTuple(float32, 2), FLOAT_IMAGE)
)
def _draw(
    words: Words,
    cell_m: tuple[float, float, float],
    shape: tuple[int, int, int],
    focal_px: tuple[float, float],
    centre_px: tuple[float, float],
    # output
    depth_m: FloatImage,
) -> None:
    """Draw the centres of the marked cells. They come in the order of their depth, so the first in a pixel stays.

    Args:
        words: Bits of the grid, see `_mark`.
        cell_m: Size of a cell along x, y and z.
        shape: Number of cells along x, y and z.
        focal_px: Focal lengths along columns and rows.
        centre_px: Column and row of the principal point.
        depth_m: Depth in the camera of the grid, shape (H, W), zeros before; changed in place.
    """
    half = float32(0.5)
    for at in range(len(words)):
        if words[at] == 0:
            continue
        for bit in range(32):
            if (words[at] >> uint32(bit)) & uint32(1):
                line, x = divmod(32 * at + bit, shape[0])
                z, y = divmod(line, shape[1])
                x_m = (float32(x - shape[0] // 2) + half) * cell_m[0]
                y_m = (float32(y - shape[1] // 2) + half) * cell_m[1]
                z_m = (float32(z) + half) * cell_m[2]
                col = x_m / z_m * focal_px[0] + centre_px[0] + half
                row = y_m / z_m * focal_px[1] + centre_px[1] + half
                is_inside = (col >= 0) & (col < depth_m.shape[1]) & (row >= 0) & (row < depth_m.shape[0])
                if is_inside and depth_m[int64(row), int64(col)] == 0:
                    depth_m[int64(row), int64(col)] = z_m
