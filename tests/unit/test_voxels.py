"""Laws of the voxel grid."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.voxel_twins import integrate_points, occupied_centres
from voxdepth.geometry import back_project, transform
from voxdepth.paper.voxels import VoxelConfig, VoxelGrid
from voxdepth.types import Intrinsics

SMALL = VoxelConfig(half_width_m=6.0, half_height_m=4.0, depth_m=10.0)
CAMERA = Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80)


def cloud(seed: int, n: int = 500) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.uniform(-1, 1, size=(n, 3)) * [5, 3, 4] + [0, 0, 5]).astype(np.float32)


def test_the_default_grid_is_packed_in_less_than_48_megabytes() -> None:
    grid = VoxelGrid(VoxelConfig(), CAMERA)
    assert grid.words.nbytes < 48e6
    assert grid.words.nbytes * 8 == pytest.approx(np.prod(VoxelConfig().shape), rel=1e-5)


@given(st.integers(0, 1000))
def test_every_point_is_within_half_a_voxel_of_an_occupied_centre(seed: int) -> None:
    points, grid = cloud(seed, 40), VoxelGrid(SMALL, CAMERA)
    integrate_points(grid, points)
    centres = occupied_centres(grid)
    assert len(centres) <= len(points)
    off_cells = np.abs(points[:, None] - centres[None]) / np.array(SMALL.cell_m)
    assert (off_cells.max(axis=2).min(axis=1) <= 0.5 + 1e-3).all()


def test_clearing_empties_the_grid() -> None:
    grid = VoxelGrid(SMALL, CAMERA)
    integrate_points(grid, cloud(0))
    grid.clear()
    assert len(occupied_centres(grid)) == 0


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_images_give_the_voxels_of_their_moved_points(yaw: float) -> None:
    depth_m = np.random.default_rng(1).uniform(1, 8, CAMERA.shape).astype(np.float32)
    depth_m[::7] = 0
    T = np.eye(4)
    T[:3, :3] = [[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]]
    T[:3, 3] = 0.2, -0.1, 0.5
    by_image, by_points = VoxelGrid(SMALL, CAMERA), VoxelGrid(SMALL, CAMERA)
    by_image.integrate(depth_m, T)
    integrate_points(by_points, transform(T, back_project(depth_m, CAMERA)))
    differing = np.bitwise_count(by_image.words ^ by_points.words).sum()
    assert differing <= 0.002 * len(occupied_centres(by_points))  # points on the border of two cells, by rounding


def test_cells_may_be_chosen() -> None:
    coarse = VoxelGrid(SMALL.model_copy(update={"cell_m": (1.0, 1.0, 1.0)}), CAMERA)
    integrate_points(coarse, np.array([[0.2, 0.2, 3.2], [0.7, 0.9, 3.9], [1.2, 0.2, 3.2]], np.float32))
    np.testing.assert_array_equal(occupied_centres(coarse), [[0.5, 0.5, 3.5], [1.5, 0.5, 3.5]])


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
        VoxelConfig(**bad)  # type: ignore[arg-type]
