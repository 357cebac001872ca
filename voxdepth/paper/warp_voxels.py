"""The voxel grid of the paper's method on a GPU, or on Warp's CPU device.

The tests run it on Warp's CPU device and compare it with `VoxelGrid`. Cells and pixels are found by single
multiplications, additions and a floor in the order of the loops for the CPU, so that both give the same bits.
"""

# mypy: disable-error-code="no-untyped-def,type-arg,valid-type,untyped-decorator,no-any-return,index,misc,operator"
import numpy as np
import warp as wp

from ..arithmetic import matmul
from ..devices import quiet_warp
from ..geometry import RayMap
from ..types import FloatArray, FloatImage, Intrinsics
from .voxels import OccupiedVoxels, VoxelConfig

wp.set_module_options({"enable_backward": False, "fuse_fp": False})


@wp.kernel
def set_bits_of_image(
    depth_m: wp.array2d(dtype=wp.float32),
    rows: wp.array2d(dtype=wp.float32),
    cols: wp.array2d(dtype=wp.float32),
    offset: wp.vec3,
    shape: wp.vec3i,
    # output
    words: wp.array(dtype=wp.uint32),
):
    """Mark the cell of each valid pixel: paper, Algorithm 1, one thread per pixel.

    Args:
        depth_m: Measured depth, shape (H, W); 0 = invalid.
        rows: What each row adds per metre of depth to the three coordinates in cells, shape (3, H); see `RayMap`.
        cols: What each column adds, shape (3, W).
        offset: The coordinates of the camera in cells.
        shape: Number of cells along x, y and z.
        words: Bits of the grid as those of `VoxelGrid`, shape (`VoxelConfig.n_words`,); changed in place.
    """
    v, u = wp.tid()
    depth = depth_m[v, u]
    x = (rows[0, v] + cols[0, u]) * depth + offset[0]
    y = (rows[1, v] + cols[1, u]) * depth + offset[1]
    z = (rows[2, v] + cols[2, u]) * depth + offset[2]
    inside_x = x >= 0.0 and x < wp.float32(shape[0])
    inside_y = y >= 0.0 and y < wp.float32(shape[1])
    inside_z = z >= 0.0 and z < wp.float32(shape[2])
    if depth > 0.0 and inside_x and inside_y and inside_z:
        cell = (wp.int32(z) * shape[1] + wp.int32(y)) * shape[0] + wp.int32(x)
        wp.atomic_or(words, cell >> 5, wp.uint32(1) << wp.uint32(cell & 31))


@wp.kernel
def splat_voxels(
    words: wp.array(dtype=wp.uint32),
    cell_m: wp.vec3,
    shape: wp.vec3i,
    focal_px: wp.vec2,
    centre_px: wp.vec2,
    # output
    depth_m: wp.array2d(dtype=wp.float32),
):
    """Keep the nearest centre of all marked cells in each pixel, as a z-buffer, one thread per word.

    Args:
        words: Bits of the grid as those of `VoxelGrid`, shape (`VoxelConfig.n_words`,).
        cell_m: Size of a cell along x, y and z.
        shape: Number of cells along x, y and z.
        focal_px: Focal lengths along columns and rows.
        centre_px: Column and row of the principal point.
        depth_m: Depth in the camera of the grid, shape (H, W), infinite before; changed in place.
    """
    at = wp.tid()
    word = words[at]
    if word == wp.uint32(0):
        return
    for bit in range(32):
        if (word >> wp.uint32(bit)) & wp.uint32(1) != wp.uint32(0):
            cell = at * 32 + bit
            x, y, z = cell % shape[0], cell // shape[0] % shape[1], cell // shape[0] // shape[1]
            px = (wp.float32(x - shape[0] // 2) + 0.5) * cell_m[0]
            py = (wp.float32(y - shape[1] // 2) + 0.5) * cell_m[1]
            pz = (wp.float32(z) + 0.5) * cell_m[2]
            col = px / pz * focal_px[0] + centre_px[0] + 0.5
            row = py / pz * focal_px[1] + centre_px[1] + 0.5
            inside_col = col >= 0.0 and col < wp.float32(depth_m.shape[1])
            inside_row = row >= 0.0 and row < wp.float32(depth_m.shape[0])
            if inside_col and inside_row:
                wp.atomic_min(depth_m, wp.int32(row), wp.int32(col), pz)


class WarpVoxelGrid:
    """A `VoxelGrid` on `cuda` or on Warp's `cpu`, which is several times slower than Numba's loops."""

    def __init__(self, config: VoxelConfig, intrinsics: Intrinsics, *, device: str) -> None:
        quiet_warp()
        wp.load_module(__name__, device=device)  # The first launch would compile them.
        self.config = config
        self._intrinsics = intrinsics
        self._device = device
        self._words = wp.zeros(config.n_words, dtype=wp.uint32, device=device)

    def clear(self) -> None:
        """Empty the grid."""
        self._words.zero_()

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """See `VoxelGrid`."""
        rays = RayMap.of(self._intrinsics, matmul(self.config.T_cells_m, T_grid_cam))
        images = [wp.array(image, dtype=wp.float32, device=self._device) for image in (depth_m, rays.rows, rays.cols)]
        inputs = [*images, wp.vec3(*rays.offset), wp.vec3i(*self.config.shape)]
        wp.launch(set_bits_of_image, depth_m.shape, inputs, [self._words], device=self._device)

    def project(self) -> FloatImage:
        """See `VoxelGrid`."""
        depth_m, camera = wp.full(self._intrinsics.shape, np.inf, wp.float32, device=self._device), self._intrinsics
        lens = wp.vec2(camera.fx_px, camera.fy_px), wp.vec2(camera.cx_px, camera.cy_px)
        inputs = [self._words, wp.vec3(*self.config.cell_m), wp.vec3i(*self.config.shape), *lens]
        wp.launch(splat_voxels, self.config.n_words, inputs, [depth_m], device=self._device)
        projected_m: FloatImage = depth_m.numpy()
        projected_m[np.isinf(projected_m)] = 0
        return projected_m

    def occupied(self) -> OccupiedVoxels:
        """Return the voxels of the grid as they are now."""
        return OccupiedVoxels.of(self._words.numpy(), self.config)
