"""Camera motion from two rendered frames, with what a real sensor does to them."""

import numpy as np
import pytest

from sim import frames
from sim.noise import photon_noise
from sim.render import create_renderer
from tests.helpers import block, camera_at, wall, world_of
from voxdepth.odometry import OdometryConfig, PhotometricOdometry, motion_from_priors
from voxdepth.types import Frame, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=320, height_px=180, hfov_deg=86)
STEP_M = 0.118


def rendered(x: float, y: float, yaw: float, *, holes: float, seed: int) -> Frame:
    with world_of(wall(6.0), block(3.0, 1.0)) as world:
        camera = camera_at(x, y, 0.0, frames.quaternion_from_yaw(yaw), CAMERA)
        image = create_renderer("raycast", world).render([camera])[0]
    rng = np.random.default_rng(seed)
    depth = image.depth_m * (1 + 0.005 * rng.standard_normal(CAMERA.shape))
    depth[rng.random(CAMERA.shape) < holes] = 0
    gray = photon_noise(image.gray, 1.5, seed, seed=0)
    return Frame(stamp_s=float(seed), gray=gray, depth_m=depth.astype(np.float32), T_world_cam=camera.T_world_cam)


@pytest.mark.parametrize("holes", [0.0, 0.15])
@pytest.mark.parametrize(("x", "y", "yaw"), [(STEP_M, 0.0, 0.0), (0.08, 0.087, 0.02)])
def test_a_step_is_measured_within_a_centimetre(x: float, y: float, yaw: float, holes: float) -> None:
    first, second = rendered(0, 0, 0, holes=holes, seed=1), rendered(x, y, yaw, holes=holes, seed=2)
    motion = PhotometricOdometry(CAMERA).estimate(first, second)
    true = motion_from_priors(first, second)
    assert true is not None
    assert motion.ok
    assert np.linalg.norm(motion.T_target_source[:3, 3] - true.T_target_source[:3, 3]) < 0.01
    np.testing.assert_allclose(motion.T_target_source[:3, :3], true.T_target_source[:3, :3], atol=0.005)


def test_steps_beyond_the_bound_are_failures() -> None:
    first, second = rendered(0, 0, 0, holes=0, seed=1), rendered(STEP_M, 0, 0, holes=0, seed=2)
    motion = PhotometricOdometry(CAMERA, OdometryConfig(max_translation_m=0.05)).estimate(first, second)
    assert not motion.ok
    np.testing.assert_array_equal(motion.T_target_source, np.eye(4))


def test_frames_without_depth_are_failures() -> None:
    blank = Frame(stamp_s=0, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=np.zeros(CAMERA.shape, np.float32))
    assert not PhotometricOdometry(CAMERA).estimate(blank, blank).ok


def test_priors_map_the_source_camera_into_the_target_camera() -> None:
    first, second = rendered(0, 0, 0, holes=0, seed=1), rendered(STEP_M, 0, 0, holes=0, seed=2)
    motion = motion_from_priors(first, second)
    assert motion is not None
    ahead = motion.T_target_source @ [0, 0, 3, 1]
    np.testing.assert_allclose(ahead, [0, 0, 3 - STEP_M, 1], atol=1e-12)
