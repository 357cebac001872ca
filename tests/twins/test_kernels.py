"""The voxel grid for a GPU, here on Warp's CPU device, gives the bits of that on the CPU."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.voxel_twins import occupied_centres, project_nearest
from voxdepth.paper.voxels import VoxelConfig, VoxelGrid
from voxdepth.paper.warp_voxels import WarpVoxelGrid
from voxdepth.types import Intrinsics

GRID = VoxelConfig(half_width_m=6.0, half_height_m=4.0, depth_m=10.0)
CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)

DEPTHS = {
    "empty": np.zeros(CAMERA.shape, np.float32),
    "one pixel": np.where(np.arange(48 * 64).reshape(48, 64) == 777, np.float32(3.3), np.float32(0)),
    "nan": np.full(CAMERA.shape, np.nan, np.float32),
    "beyond": np.full(CAMERA.shape, 1e9, np.float32),
    "infinite": np.full(CAMERA.shape, np.inf, np.float32),
    "negative": np.full(CAMERA.shape, -2.0, np.float32),
}
TURNED = np.array([[0.98, -0.05, 0.2, 0.1], [0.06, 0.99, -0.02, -0.2], [-0.2, 0.03, 0.97, 0.3], [0, 0, 0, 1]])


def depth_image(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.2, 12, CAMERA.shape).astype(np.float32)
    depth_m[rng.random(CAMERA.shape) < 0.3] = 0
    return depth_m


def both_grids(voxels: VoxelConfig = GRID) -> tuple[VoxelGrid, WarpVoxelGrid]:
    return VoxelGrid(voxels, CAMERA), WarpVoxelGrid(voxels, CAMERA, device="cpu")


@given(st.integers(0, 1000))
def test_voxels_of_images_agree(seed: int) -> None:
    host, warp = both_grids()
    for depth_m, T in ((depth_image(seed), np.eye(4)), (depth_image(seed + 1), TURNED)):
        host.integrate(depth_m, T)
        warp.integrate(depth_m, T)
    np.testing.assert_array_equal(host.words, warp._words.numpy())
    projected = host.project(), warp.project()
    assert projected[0].any()
    np.testing.assert_array_equal(*projected)


@pytest.mark.parametrize("name", DEPTHS)
@pytest.mark.parametrize("T", [np.eye(4), TURNED])
def test_voxels_of_degenerate_images_agree(name: str, T: np.ndarray) -> None:
    host, warp = both_grids()
    host.integrate(DEPTHS[name], T)
    warp.integrate(DEPTHS[name], T)
    np.testing.assert_array_equal(host.words, warp._words.numpy())
    assert len(occupied_centres(host)) == (name == "one pixel")
    np.testing.assert_array_equal(host.project(), warp.project())


@pytest.mark.parametrize("cells", [(3, 2, 900), (40, 3, 7), (1, 1, 1)])
def test_grids_whose_rows_end_within_a_word_are_projected_alike(cells: tuple[int, int, int]) -> None:
    x, y, z = cells
    voxels = VoxelConfig(cell_m=(0.1, 0.1, 0.01), half_width_m=0.1 * x, half_height_m=0.1 * y, depth_m=0.01 * z)
    host, warp = both_grids(voxels)
    host.words[:] = np.random.default_rng(5).integers(0, 2**32, voxels.n_words, np.uint32)
    host.words[-1] = 0  # Its last bits belong to no cell.
    warp._words.assign(host.words)
    expected = project_nearest(occupied_centres(host), CAMERA)
    np.testing.assert_array_equal(host.project(), expected)
    np.testing.assert_array_equal(warp.project(), expected)
