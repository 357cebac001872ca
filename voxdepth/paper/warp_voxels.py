"""The voxel grid of the paper's method on a GPU, or on Warp's CPU device."""

import numpy as np
import warp as wp

from ..devices import quiet_warp
from ..geometry import RayMap
from ..types import FloatArray, FloatImage, Intrinsics
from . import warp_kernels as kernels
from .voxels import OccupiedVoxels, VoxelConfig


class WarpVoxelGrid:
    """A `VoxelGrid` on `cuda` or on Warp's `cpu`, which is several times slower than Numba's loops."""

    def __init__(self, config: VoxelConfig, intrinsics: Intrinsics, *, device: str) -> None:
        quiet_warp()
        wp.load_module(kernels, device=device)  # The first launch would compile them.
        self.config = config
        self._intrinsics = intrinsics
        self._device = device
        self._words = wp.zeros(config.n_words, dtype=wp.uint32, device=device)

    def clear(self) -> None:
        """Empty the grid."""
        self._words.zero_()

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """See `VoxelGrid`."""
        rays = RayMap.of(self._intrinsics, self.config.T_cells_m @ T_grid_cam)
        images = [wp.array(image, dtype=wp.float32, device=self._device) for image in (depth_m, rays.rows, rays.cols)]
        inputs = [*images, wp.vec3(*rays.offset), wp.vec3i(*self.config.shape)]
        wp.launch(kernels.set_bits_of_image, depth_m.shape, inputs, [self._words], device=self._device)

    def project(self) -> FloatImage:
        """See `VoxelGrid`."""
        depth_m, camera = wp.full(self._intrinsics.shape, np.inf, wp.float32, device=self._device), self._intrinsics
        lens = wp.vec2(camera.fx_px, camera.fy_px), wp.vec2(camera.cx_px, camera.cy_px)
        inputs = [self._words, wp.vec3(*self.config.cell_m), wp.vec3i(*self.config.shape), *lens]
        wp.launch(kernels.splat_voxels, self.config.n_words, inputs, [depth_m], device=self._device)
        projected_m: FloatImage = depth_m.numpy()
        projected_m[np.isinf(projected_m)] = 0
        return projected_m

    def occupied(self) -> OccupiedVoxels:
        """The voxels of the grid as they are now."""
        return OccupiedVoxels.of(self._words.numpy(), self.config)
