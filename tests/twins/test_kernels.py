"""Each Warp kernel gives the bits of its NumPy twin."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from voxdepth.combine import combine
from voxdepth.projection import project_nearest
from voxdepth.types import Intrinsics
from voxdepth.voxels import VoxelConfig, VoxelGrid

GRID = VoxelConfig(half_width_m=6.0, half_height_m=4.0, depth_m=10.0)
CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)

DEGENERATE = {
    "none": np.empty((0, 3), np.float32),
    "one": np.array([[0.0, 0.0, 3.0]], np.float32),
    "nan": np.array([[np.nan, 0.0, 3.0], [0.1, 0.2, 4.0], [0.0, np.nan, np.nan]], np.float32),
    "beyond": np.array([[100.0, 0.0, 3.0], [0.0, 0.0, 1e9], [0.0, -50.0, 2.0], [np.inf, 0.0, 1.0]], np.float32),
    "behind": np.array([[0.0, 0.0, -3.0], [1.0, 1.0, 0.0]], np.float32),
    "same cell": np.full((7, 3), 1.01, np.float32),
}


def cloud(seed: int, n: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(n, 3)) * [3, 2, 2] + [0, 0, 4]).astype(np.float32)


def both_grids(points: np.ndarray) -> tuple[VoxelGrid, VoxelGrid]:
    grids = VoxelGrid(GRID, backend="warp"), VoxelGrid(GRID, backend="numpy")
    for grid in grids:
        grid.integrate(points)
    return grids


@given(st.integers(0, 1000), st.integers(1, 3000))
def test_voxels_agree(seed: int, n: int) -> None:
    warp, numpy = both_grids(cloud(seed, n))
    assert warp.words.any()
    np.testing.assert_array_equal(warp.words, numpy.words)


@pytest.mark.parametrize("name", DEGENERATE)
def test_voxels_agree_on_degenerate_clouds(name: str) -> None:
    warp, numpy = both_grids(DEGENERATE[name])
    np.testing.assert_array_equal(warp.words, numpy.words)
    expected = {"none": 0, "one": 1, "nan": 1, "beyond": 0, "behind": 1, "same cell": 1}[name]
    assert len(warp.occupied_centres()) == expected


@given(st.integers(0, 1000), st.integers(1, 3000))
def test_projections_agree(seed: int, n: int) -> None:
    points = cloud(seed, n)
    warp = project_nearest(points, CAMERA, backend="warp")
    numpy = project_nearest(points, CAMERA, backend="numpy")
    np.testing.assert_array_equal(warp, numpy)


@pytest.mark.parametrize("name", ["none", "one", "beyond", "behind", "same cell"])
def test_projections_agree_on_degenerate_clouds(name: str) -> None:
    with np.errstate(invalid="ignore"):
        warp = project_nearest(DEGENERATE[name], CAMERA, backend="warp")
        numpy = project_nearest(DEGENERATE[name], CAMERA, backend="numpy")
    np.testing.assert_array_equal(warp, numpy)


@given(st.integers(0, 1000))
def test_combinations_agree(seed: int) -> None:
    rng = np.random.default_rng(seed)
    raw, template = (rng.uniform(0, 10, (31, 3)).astype(np.float32) for _ in range(2))
    raw[rng.random(raw.shape) < 0.3] = 0
    template[rng.random(raw.shape) < 0.3] = 0
    for warp, numpy in zip(combine(raw, template, backend="warp"), combine(raw, template), strict=True):
        np.testing.assert_array_equal(warp, numpy)
