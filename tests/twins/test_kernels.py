"""The steps on the CPU and the Warp kernels for a GPU, here on Warp's CPU device, give the bits of their twins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.voxel_twins import occupied_centres, project_nearest
from voxdepth import VoxDepthConfig
from voxdepth.paper.steps import HostSteps
from voxdepth.paper.voxels import VoxelConfig
from voxdepth.paper.warp_steps import WarpSteps
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


def both_steps(**changes: object) -> tuple[HostSteps, WarpSteps]:
    config = VoxDepthConfig().model_copy(update={"voxels": GRID} | changes)
    return HostSteps(CAMERA, config), WarpSteps(CAMERA, config, device="cpu")


@given(st.integers(0, 1000))
def test_voxels_of_images_agree(seed: int) -> None:
    host, warp = both_steps()
    for depth_m, T in ((depth_image(seed), np.eye(4)), (depth_image(seed + 1), TURNED)):
        host.integrate(depth_m, T)
        warp.integrate(depth_m, T)
    np.testing.assert_array_equal(host._grid.words, warp._words.numpy())
    projected = host.project(), warp.project().numpy()
    assert projected[0].any()
    np.testing.assert_array_equal(*projected)


@pytest.mark.parametrize("name", DEPTHS)
@pytest.mark.parametrize("T", [np.eye(4), TURNED])
def test_voxels_of_degenerate_images_agree(name: str, T: np.ndarray) -> None:
    host, warp = both_steps()
    host.integrate(DEPTHS[name], T)
    warp.integrate(DEPTHS[name], T)
    np.testing.assert_array_equal(host._grid.words, warp._words.numpy())
    assert len(occupied_centres(host._grid)) == (name == "one pixel")
    np.testing.assert_array_equal(host.project(), warp.project().numpy())


@pytest.mark.parametrize("cells", [(3, 2, 900), (40, 3, 7), (1, 1, 1)])
def test_grids_whose_rows_end_within_a_word_are_projected_alike(cells: tuple[int, int, int]) -> None:
    x, y, z = cells
    voxels = VoxelConfig(cell_m=(0.1, 0.1, 0.01), half_width_m=0.1 * x, half_height_m=0.1 * y, depth_m=0.01 * z)
    host, warp = both_steps(voxels=voxels)
    host._grid.words[:] = np.random.default_rng(5).integers(0, 2**32, voxels.n_words, np.uint32)
    host._grid.words[-1] = 0  # Its last bits belong to no cell.
    warp._words.assign(host._grid.words)
    expected = project_nearest(occupied_centres(host._grid), CAMERA)
    np.testing.assert_array_equal(host.project(), expected)
    np.testing.assert_array_equal(warp.project().numpy(), expected)


@pytest.mark.parametrize(
    "M",
    [
        [[1.0, 0, 0], [0, 1, 0]],
        [[1.0, 0, 0.5], [0, 1, -1.5]],
        [[1.013, 0.021, 3.3], [-0.013, 0.991, -2.7]],
        [[-0.7, 0.7, 20.2], [0.7, 0.7, -5.1]],
        [[1.0, 0, 1000], [0, 1, 0]],
    ],
)
def test_warped_templates_agree(M: list[list[float]]) -> None:
    host, warp = both_steps()
    template = depth_image(4)
    expected, got = host.warp(template, np.array(M)), warp.warp(warp.upload(template), np.array(M)).numpy()
    row, col = np.nonzero(expected != got)
    position = (np.linalg.inv([*M, [0, 0, 1]]) @ np.stack([col, row, np.ones_like(row)]))[:2]
    # OpenCV computes in fixed point: a position a thousandth off the middle of two pixels may go to either.
    to_a_middle = np.abs(position - np.floor(position) - 0.5).min(axis=0)
    assert len(row) < 0.05 * template.size
    assert (to_a_middle < 1e-3).all()


@given(st.integers(0, 1000), st.booleans(), st.sampled_from([3.0, 65.0]))
def test_combinations_agree(seed: int, only_empty: bool, empty_from_m: float) -> None:
    host, warp = both_steps(only_empty=only_empty, empty_from_m=empty_from_m)
    raw, template = depth_image(seed), depth_image(seed + 1)
    got = warp.combine(warp.upload(raw), warp.upload(template))
    for expected, image in zip(host.combine(raw, template), got, strict=True):
        np.testing.assert_array_equal(expected, image.numpy())


@given(st.integers(0, 1000), st.sampled_from([1, 3, 5]))
def test_medians_agree(seed: int, size: int) -> None:
    host, warp = both_steps(median_size_px=size)
    depth_m = depth_image(seed)
    depth_m[10:20] = 4.0
    np.testing.assert_array_equal(host.filter(depth_m), warp.filter(warp.upload(depth_m)).numpy())
