"""Boolean voxel grid, packed in bits: paper, Algorithm 1 and Eq. voxelor."""

from typing import Literal

import numpy as np
import numpy.typing as npt
import warp as wp
from pydantic import Field, model_validator

from . import kernels
from .errors import ConfigError
from .geometry import PointArray
from .model import Model

Backend = Literal["warp", "numpy"]
Words = npt.NDArray[np.uint32]


class VoxelConfig(Model):
    """Cells and extents of the grid. Smaller cells keep more detail and need more memory."""

    cell_m: tuple[float, float, float] = Field((0.1, 0.1, 0.065), strict=False)
    """Size of a voxel along x, y and z of the camera [m]. Paper: 0.1, 0.1, 0.065."""
    half_width_m: float = Field(40.0, gt=0)
    """Extent to the left and to the right of the optical axis [m]."""
    half_height_m: float = Field(16.0, gt=0)
    """Extent above and below the optical axis [m]."""
    depth_m: float = Field(41.0, gt=0)
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
        cx, cy, cz = self.cell_m
        return (
            2 * int(np.ceil(self.half_width_m / cx)),
            2 * int(np.ceil(self.half_height_m / cy)),
            int(np.ceil(self.depth_m / cz)),
        )


class VoxelGrid:
    """A set of occupied voxels in the camera frame. Adding a cloud is the Boolean OR of the paper."""

    def __init__(self, config: VoxelConfig, *, backend: Backend = "warp") -> None:
        if backend not in ("warp", "numpy"):
            raise ConfigError(f"backend must be 'warp' or 'numpy', got {backend!r}")
        self.config = config
        self._mark = mark_warp if backend == "warp" else mark_numpy
        if backend == "warp":
            wp.load_module(kernels, device="cpu")
        self.words: Words = np.zeros((int(np.prod(config.shape)) + 31) // 32, np.uint32)

    def clear(self) -> None:
        """Empty the grid."""
        self.words.fill(0)

    def integrate(self, points: PointArray) -> None:
        """OR the voxels of points [m], shape (N, 3), into the grid. Points outside of it, and NaN, are left out."""
        if points.size:
            self._mark(points, self.config, self.words)

    def occupied_centres(self) -> PointArray:
        """Centres of all occupied voxels [m], shape (N, 3), float32, in the order of the grid."""
        at = np.flatnonzero(self.words)
        bits = np.unpackbits(self.words[at].view(np.uint8).reshape(-1, 4), axis=1, bitorder="little")
        word, bit = np.nonzero(bits)
        cells = np.stack(np.unravel_index(at[word] * 32 + bit, self.config.shape), axis=1)
        nx, ny, _ = self.config.shape
        centred = cells.astype(np.float32) + np.float32(0.5) - np.array([nx // 2, ny // 2, 0], np.float32)
        return centred * np.array(self.config.cell_m, np.float32)


def mark_warp(points: PointArray, config: VoxelConfig, words: Words) -> None:
    """Set the bits of the points' voxels in `words`, by the Warp kernel."""
    wp.launch(
        kernels.set_voxels,
        len(points),
        inputs=[kernels.view(points, wp.vec3), wp.vec3(*config.cell_m), wp.vec3i(*config.shape)],
        outputs=[kernels.view(words, wp.uint32)],
        device="cpu",
    )


def mark_numpy(points: PointArray, config: VoxelConfig, words: Words) -> None:
    """Set the bits of the points' voxels in `words`: the twin of `mark_warp`."""
    nx, ny, _ = config.shape
    cells = np.floor(points / np.array(config.cell_m, np.float32)) + np.array([nx // 2, ny // 2, 0], np.float32)
    with np.errstate(invalid="ignore"):
        inside = ((cells >= 0) & (cells < np.array(config.shape, np.float32))).all(axis=1)
    flat = np.ravel_multi_index(tuple(cells[inside].astype(np.int64).T), config.shape)
    np.bitwise_or.at(words, flat >> 5, np.uint32(1) << (flat & 31).astype(np.uint32))
