"""From a depth image to what is free in each direction."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.frames import R_BODY_CAM, pose
from swarm.errors import MissionError
from swarm.obstacles import HistogramBuilder, HistogramConfig
from tests.helpers import CAMERA
from tests.swarm_scenes import AT_ORIGIN, MOUNT_CAM_M, corrected, flat, histogram, turn
from voxdepth.types import Intrinsics

UNKNOWN_M = HistogramConfig().unknown_range_m


@given(st.floats(1, 20))
def test_a_wall_reads_its_distance_along_each_ray(depth_m: float) -> None:
    h = histogram(flat(depth_m))
    camera_m = depth_m / h.directions_world[..., 0]
    distance_m = np.linalg.norm(camera_m[..., None] * h.directions_world + [0.27, 0, 0], axis=-1)
    assert not h.unknown.any()
    assert (np.abs(h.range_m - distance_m) < 0.12 * distance_m).all()
    assert (h.range_m <= distance_m * 1.02).all()


def test_single_noisy_pixels_do_not_matter_but_a_pole_does() -> None:
    depth = flat(10.0)
    depth[::12, ::12] = 0.5
    assert histogram(depth).range_m.min() > 9
    depth = flat(10.0)
    depth[:, 78:82] = 2.0
    assert histogram(depth).range_m[:, 7].max() < 2.8


def test_holes_and_distrusted_pixels_are_unknown() -> None:
    depth = flat(10.0)
    depth[:, :80] = 0
    h = histogram(depth)
    assert h.unknown[:, :6].all()
    assert not h.unknown[:, 9:].any()
    from_camera_m = np.linalg.norm(h.surfaces_m - h.camera_m, axis=-1)
    np.testing.assert_allclose(from_camera_m[h.unknown], UNKNOWN_M)


@pytest.mark.parametrize(("confidence", "unknown"), [(0.19, True), (0.2, False), (0.21, False)])
def test_pixels_of_little_confidence_count_as_holes(confidence: float, unknown: bool) -> None:
    image = corrected(flat(5.0))
    image.confidence[:] = confidence
    h = HistogramBuilder(CAMERA, HistogramConfig(), MOUNT_CAM_M, UNKNOWN_M).build(image, AT_ORIGIN)
    assert (h.unknown == unknown).all()


@given(st.floats(1, 20), st.floats(-1, 1), st.floats(-3, 3), st.floats(-3, 3))
def test_surfaces_are_where_they_are_wherever_the_camera_sits(depth_m: float, yaw: float, x: float, y: float) -> None:
    rotation = turn(yaw)
    h = histogram(flat(depth_m), pose(rotation @ R_BODY_CAM, np.array([x, y, 2.0])))
    along = rotation[:, 0]
    np.testing.assert_allclose(h.origin_m, np.array([x, y, 2.0]) - 0.27 * along, atol=1e-9)
    depths_m = (h.surfaces_m - h.camera_m) @ along
    assert (np.abs(depths_m - depth_m) < 0.12 * depth_m).all()


@given(st.integers(0, 1000))
def test_a_mirrored_image_gives_the_mirrored_histogram(seed: int) -> None:
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random(CAMERA.shape) < 0.2, 0, rng.uniform(1, 20, CAMERA.shape)).astype(np.float32)
    h, mirrored = histogram(depth), histogram(depth[:, ::-1].copy())
    np.testing.assert_allclose(mirrored.range_m, h.range_m[:, ::-1], rtol=1e-6)
    np.testing.assert_array_equal(mirrored.unknown, h.unknown[:, ::-1])
    np.testing.assert_allclose(mirrored.directions_world, h.directions_world[:, ::-1] * [1, -1, 1], atol=1e-9)


def test_images_with_fewer_pixels_than_cells_are_refused() -> None:
    with pytest.raises(MissionError, match="of 160x120 is read: too few for a histogram of 7 rows and 200 columns"):
        HistogramBuilder(CAMERA, HistogramConfig(cols=200), MOUNT_CAM_M, UNKNOWN_M)


@pytest.mark.parametrize(("width_px", "height_px"), [(160, 120), (320, 180), (640, 480), (97, 65)])
def test_images_of_any_size_are_used_up_to_their_borders(width_px: int, height_px: int) -> None:
    camera = Intrinsics.from_hfov(width_px=width_px, height_px=height_px, hfov_deg=86, baseline_m=0.095)
    builder = HistogramBuilder(camera, HistogramConfig(), MOUNT_CAM_M, UNKNOWN_M)
    h = builder.build(corrected(np.full(camera.shape, 5.0, np.float32)), AT_ORIGIN)
    assert not h.unknown.any()
    sideways = h.directions_world[3, :, 1] / h.directions_world[3, :, 0]
    assert sideways[0] == pytest.approx(-sideways[-1], abs=1.01 / camera.fx_px)
    half_cell = (sideways[0] - sideways[1]) / 2
    left_over_px = max(1, height_px // 120) * 15 / 2
    assert sideways[0] + half_cell > np.tan(np.radians(43)) - left_over_px / camera.fx_px
