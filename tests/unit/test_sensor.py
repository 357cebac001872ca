"""Laws of cameras, stereo and noise."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from sim.bodies import Body, Box, Cylinder
from sim.camera_noise import exposure_gain
from sim.depth_noise import DepthNoise, Disparity, PatchFlicker, Scale
from sim.errors import SensorError
from sim.render import create_renderer
from sim.sensor import RigConfig, StereoSensor
from sim.stereo import StereoConfig, StereoMatcher, occlusion_mask
from sim.types import CameraImages, Capture
from tests.helpers import AT_ORIGIN, CAMERA, block, camera_at, captured, wall, world_of
from voxdepth.types import Intrinsics

BASELINE_M = 0.095
THETA = DepthNoise(scale=Scale(theta=0.3))
WIDE = RigConfig(width_px=640, height_px=360).intrinsics


def stereo_pair(*bodies: Body, intrinsics: Intrinsics = WIDE) -> tuple[CameraImages, CameraImages]:
    """What the left and the right camera see."""
    with world_of(*bodies) as world:
        cameras = [camera_at(0, side * BASELINE_M / 2, 0, intrinsics=intrinsics) for side in (1, -1)]
        left, right = create_renderer("raycast", world).render(cameras)
    return left, right


@pytest.mark.parametrize("renderer", ["raycast", "tiny"])
@pytest.mark.parametrize("distance_m", [1.0, 12.0])
def test_a_plane_reads_its_depth_and_nothing_is_infinitely_far(renderer: str, distance_m: float) -> None:
    with world_of(wall(distance_m)) as world:
        cameras = [camera_at(0, 0, 0), camera_at(0, 0, 0, q_xyzw=(0, 0, 1, 0))]
        ahead, behind = create_renderer(renderer, world).render(cameras)
    np.testing.assert_allclose(ahead.depth_m, distance_m, atol=0.003)
    assert (ahead.segment_id == 0).all()
    assert np.isinf(behind.depth_m).all()
    assert (behind.segment_id == -1).all()


def test_far_surfaces_and_holes_are_distinguished() -> None:
    matcher = StereoMatcher(CAMERA, StereoConfig(), max_depth_m=40.0)
    depth = matcher.triangulate(np.array([[-16, 0, 1, 64]], np.int16))
    np.testing.assert_allclose(depth, [[0, 40, 40, CAMERA.fx_px * BASELINE_M / 4]], rtol=1e-6)


def test_bright_frames_saturate_and_dark_ones_lose_their_texture() -> None:
    config = RigConfig(width_px=160, height_px=120, mount_forward_m=0.0, exposure_sigma=1.2)
    darkest, *_, brightest = sorted(range(100), key=lambda frame: exposure_gain(1.2, 0, frame, seed=0))
    with world_of(wall(3.0)) as world:
        sensor = StereoSensor(world, create_renderer("raster", world), config, seed=0)
        dark, bright = (sensor.capture(sensor.render([AT_ORIGIN], frame)[0]) for frame in (darkest, brightest))
    assert (bright.gray_left == 255).mean() > 0.9
    assert (bright.depth_raw_m == 0).mean() > 0.5
    assert dark.gray_left.mean() < 20
    assert (dark.depth_raw_m == 0).mean() > 0.5


@pytest.mark.parametrize("depth", ["truth", "noisy", "stereo"])
def test_captures_of_the_same_seed_are_the_same_bytes_with_more_threads_and_of_some_drones(depth: str) -> None:
    config = RigConfig(width_px=96, height_px=64, depth=depth, noise=THETA if depth == "noisy" else DepthNoise())
    starts = [(0.0, 0.0, 0.0), (-1.0, 1.5, 0.0), (-2.0, -1.5, 0.5)]
    captures = []
    with ThreadPoolExecutor(2) as pool:
        for pool_map in (map, pool.map):
            with world_of(wall(4.0), starts_m=starts) as world:
                rig = StereoSensor(world, create_renderer("raycast", world), config, seed=3)
                captures.append(list(pool_map(rig.capture, rig.render_drones([0, 1, 2], frame=5))))
                (alone,) = rig.captures([2], frame=5)
        np.testing.assert_array_equal(alone.depth_raw_m, captures[-1][2].depth_raw_m)
    for one, other in zip(*captures, strict=True):
        np.testing.assert_array_equal(one.depth_raw_m, other.depth_raw_m)
        np.testing.assert_array_equal(one.gray_left, other.gray_left)


def test_a_baseline_wider_than_the_image_can_match_is_refused() -> None:
    with pytest.raises(SensorError, match="shorten the baseline"):
        captured(RigConfig(width_px=160, height_px=120, baseline_m=2.0), wall(4.0))


@pytest.mark.parametrize("radius_m", [0.01, 0.1])
def test_thin_things_cast_shadows_as_wide_as_themselves_at_most(radius_m: float) -> None:
    pole = Body(name="pole", kind="building", shape=Cylinder(radius_m, 6.0), position_m=(2.0, 0.0, 0.0))
    left, right = stereo_pair(wall(6.0), pole)
    band = int(WIDE.fx_px * BASELINE_M / 6.0) + 3
    occluded = occlusion_mask(left.depth_m, right.depth_m, WIDE)[180, band:].sum()
    step_px = WIDE.fx_px * BASELINE_M * (1 / 2.0 - 1 / 6.0)
    assert abs(occluded - min(step_px, 2 * radius_m / 2.0 * WIDE.fx_px)) <= 1.5


@pytest.mark.parametrize("yaw_deg", [0, 75])
def test_slanted_walls_hide_nothing_of_themselves(yaw_deg: float) -> None:
    shape = Box((0.2, 60.0, 60.0))
    slanted = Body(name="slanted", shape=shape, position_m=(4.0, 0.0, 0.0), yaw_rad=np.radians(yaw_deg))
    left, right = stereo_pair(slanted, intrinsics=CAMERA)
    occluded = occlusion_mask(left.depth_m, right.depth_m, CAMERA)
    col = np.arange(CAMERA.width_px) - CAMERA.fx_px * BASELINE_M / left.depth_m
    assert not occluded[col >= 0.5].any()
    assert occluded[np.isfinite(left.depth_m) & (col < -0.5)].all()


def test_every_sensor_model_with_a_right_image_reports_occlusion() -> None:
    models = [RigConfig(depth=depth, mount_forward_m=0.0) for depth in ("truth", "noisy", "stereo")]
    masks = [captured(model, wall(6.0), block(2.0, 1.0), right=True).occluded for model in models]
    assert masks[0].sum() > 100
    np.testing.assert_array_equal(masks[0], masks[1])
    np.testing.assert_array_equal(masks[0], masks[2])


def test_the_sky_keeps_its_depth_under_noise_and_nothing_reads_farther() -> None:
    noise = DepthNoise(scale=Scale(theta=0.5), disparity=Disparity(sigma_px=0.05))
    rig = RigConfig(width_px=160, height_px=120, depth="noisy", noise=noise, max_depth_m=40.0)
    capture = captured(rig, wall(30.0, side_m=20.0), seed=1)
    sky = np.isinf(capture.depth_true_m)
    assert sky.mean() > 0.2
    assert capture.depth_raw_m.max() <= 40.0
    assert np.median(capture.depth_raw_m[sky]) == 40.0


def test_noise_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="shares of all patches"):
        PatchFlicker(dropout=0.7, jump=0.7)
    with pytest.raises(ValueError, match="min_texture 2"):
        RigConfig(photon_sigma=3.0)
    assert RigConfig(photon_sigma=3.0, stereo=StereoConfig(min_texture=4.0)).photon_sigma == 3.0


def share_within(image: Capture, share: float) -> float:
    error = np.abs(image.depth_raw_m - image.depth_true_m) / image.depth_true_m
    return float(np.mean((error <= share) & (image.depth_raw_m > 0)))


def test_less_light_means_more_noise_and_less_depth() -> None:
    images = [captured(RigConfig(light_stops=stops), wall(4.0)) for stops in (0.0, -3.0, -6.0)]
    noise = [float(np.std(np.diff(image.gray_left[::2].astype(float), axis=1))) for image in images]
    assert noise == sorted(noise)
    depth = [share_within(image, 0.1) for image in images]
    assert depth[0] > 0.8
    assert depth[0] > depth[1] + 0.1 > depth[2] + 0.2
