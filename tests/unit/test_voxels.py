"""Laws of the voxel grid, on the CPU, on Warp's CPU device and on a GPU if there is one: all give the same bits."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.frames import project_nearest
from voxdepth.devices import cuda_devices
from voxdepth.geometry import PointArray, back_project, transform
from voxdepth.paper.method import create_grid
from voxdepth.paper.voxels import VoxelConfig, VoxelGrid
from voxdepth.paper.warp_voxels import WarpVoxelGrid
from voxdepth.types import FloatImage, Intrinsics

SMALL = VoxelConfig(half_width_m=6.0, half_height_m=4.0, depth_m=10.0)
CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)
TURNED = np.array([[0.98, -0.05, 0.2, 0.1], [0.06, 0.99, -0.02, -0.2], [-0.2, 0.03, 0.97, 0.3], [0, 0, 0, 1]])
DEPTHS = {
    "empty": np.zeros(CAMERA.shape, np.float32),
    "one pixel": np.where(np.arange(48 * 64).reshape(48, 64) == 777, np.float32(3.3), np.float32(0)),
    "nan": np.full(CAMERA.shape, np.nan, np.float32),
    "beyond": np.full(CAMERA.shape, 1e9, np.float32),
    "infinite": np.full(CAMERA.shape, np.inf, np.float32),
    "negative": np.full(CAMERA.shape, -2.0, np.float32),
}
GPUS = ["cuda"] if cuda_devices() else []
DEVICES = pytest.mark.parametrize("device", ["cpu", "warp-cpu", *GPUS])
WARP_DEVICES = pytest.mark.parametrize("warp_device", ["cpu", *GPUS])


def depth_image(seed: int) -> FloatImage:
    rng = np.random.default_rng(seed)
    return np.where(rng.random(CAMERA.shape) < 0.3, 0, rng.uniform(0.2, 12, CAMERA.shape)).astype(np.float32)


def both_grids(warp_device: str, config: VoxelConfig = SMALL) -> tuple[VoxelGrid, WarpVoxelGrid]:
    return VoxelGrid(config, CAMERA), WarpVoxelGrid(config, CAMERA, device=warp_device)


def cells(points_m: PointArray, config: VoxelConfig = SMALL) -> set[tuple[int, ...]]:
    """The cells of points within the grid."""
    found = np.floor(points_m / np.array(config.cell_m)).astype(int)
    half = np.array(config.shape) // (2, 2, 1)
    inside = (found >= -half * (1, 1, 0)).all(axis=1) & (found < half).all(axis=1)
    return set(map(tuple, found[inside].tolist()))


def test_the_default_grid_is_packed_in_less_than_48_megabytes() -> None:
    grid = VoxelGrid(VoxelConfig(), CAMERA)
    assert grid.words.nbytes < 48e6
    assert grid.words.nbytes * 8 == pytest.approx(np.prod(VoxelConfig().shape), rel=1e-5)


@DEVICES
@pytest.mark.parametrize("T", [np.eye(4), TURNED])
def test_images_mark_the_cells_of_their_moved_points_until_the_grid_is_cleared(device: str, T: np.ndarray) -> None:
    grid, expected = create_grid(device, SMALL, CAMERA), set()
    for seed in (1, 2):
        grid.integrate(depth_image(seed), T)
        expected |= cells(transform(T, back_project(depth_image(seed), CAMERA)))
    found = cells(grid.occupied().centres_m)
    assert len(found ^ expected) <= 0.002 * len(expected)  # points on the border of two cells, by rounding
    grid.clear()
    assert len(grid.occupied().centres_m) == 0


@WARP_DEVICES
@given(seed=st.integers(0, 1000))
def test_both_grids_have_the_same_bits_and_project_the_nearest_centres(warp_device: str, seed: int) -> None:
    host, warp = both_grids(warp_device)
    for depth_m, T in ((depth_image(seed), np.eye(4)), (depth_image(seed + 1), TURNED)):
        host.integrate(depth_m, T)
        warp.integrate(depth_m, T)
    np.testing.assert_array_equal(host.words, warp._words.numpy())
    expected = project_nearest(host.occupied().centres_m, CAMERA)
    assert expected.any()
    np.testing.assert_array_equal(host.project(), expected)
    np.testing.assert_array_equal(warp.project(), expected)


@DEVICES
@pytest.mark.parametrize("name", DEPTHS)
@pytest.mark.parametrize("T", [np.eye(4), TURNED])
def test_only_what_is_a_depth_within_the_grid_is_marked(device: str, name: str, T: np.ndarray) -> None:
    grid = create_grid(device, SMALL, CAMERA)
    grid.integrate(DEPTHS[name], T)
    assert len(grid.occupied().centres_m) == (name == "one pixel")
    assert np.isfinite(grid.project()).all()


@WARP_DEVICES
@pytest.mark.parametrize("sides", [(3, 2, 900), (40, 3, 7), (1, 1, 1)])
def test_grids_whose_rows_end_within_a_word_are_projected_alike(warp_device: str, sides: tuple[int, int, int]) -> None:
    x, y, z = sides
    config = VoxelConfig(cell_m=(0.1, 0.1, 0.01), half_width_m=0.1 * x, half_height_m=0.1 * y, depth_m=0.01 * z)
    host, warp = both_grids(warp_device, config)
    host.words[:] = np.random.default_rng(5).integers(0, 2**32, config.n_words, np.uint32)
    host.words[-1] = 0  # Its last bits belong to no cell.
    warp._words.assign(host.words)
    expected = project_nearest(host.occupied().centres_m, CAMERA)
    np.testing.assert_array_equal(host.project(), expected)
    np.testing.assert_array_equal(warp.project(), expected)


@pytest.mark.parametrize(
    "bad",
    [
        {"cell_m": (0.1, -0.1, 0.1)},
        {"cell_m": (1e-3, 1e-3, 1e-3)},
        {"cell_m": (0.1, 0.1, 1e-320)},
        {"depth_m": 0.0},
        {"depth_m": 1e308},
    ],
)
def test_impossible_grids_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        VoxelConfig(**bad)
