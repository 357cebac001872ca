"""Camera motion from two rendered frames, with what a real sensor does to them, from poses, and over a window."""

from functools import cache

import numpy as np
import pytest

from sim import frames
from sim.camera_noise import photon_noise
from sim.render import create_renderer
from sim.types import CameraImages
from tests.helpers import block, camera_at, wall, world_of
from voxdepth.geometry import inverse_rigid
from voxdepth.paper import odometry as parts
from voxdepth.paper.method import poses_in_last
from voxdepth.paper.odometry import PhotometricOdometry, motion_between
from voxdepth.types import FloatArray, Frame, Intrinsics

SMALL = Intrinsics.from_hfov(width_px=320, height_px=180, hfov_deg=86)
LARGE = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86)
STEP_M = 0.118


@cache
def clean(camera: Intrinsics, x: float, y: float, yaw: float, room: int = 0) -> tuple[CameraImages, FloatArray]:
    """A room without noise, and the camera's pose; another room has everything elsewhere."""
    bodies = [wall(6.0), block(3.0, 1.0)] if room == 0 else [wall(4.0, y_m=9.0, name="other"), block(2.0, 0.5)]
    view = camera_at(x, y, 0.0, frames.quaternion_from_yaw(yaw), camera)
    with world_of(*bodies) as world:
        return create_renderer("raycast", world).render([view])[0], view.T_world_cam


def frame(
    camera: Intrinsics = SMALL, x: float = 0, y: float = 0, yaw: float = 0, *, holes: float = 0.15, seed: int = 1,
    gain: float = 1.0, room: int = 0,
) -> Frame:  # fmt: skip
    image, T_world_cam = clean(camera, x, y, yaw, room)
    rng = np.random.default_rng(seed)
    depth_m = np.where(np.isfinite(image.depth_m), image.depth_m, 0)
    depth_m = depth_m * (1 + 0.005 * rng.standard_normal(camera.shape))
    depth_m[rng.random(camera.shape) < holes] = 0
    gray = photon_noise(image.gray, 1.5, seed, seed=0, gain=gain)
    return Frame(stamp_s=float(seed), gray=gray, depth_m=depth_m.astype(np.float32), T_world_cam=T_world_cam)


def truth(source: Frame, target: Frame) -> FloatArray:
    return inverse_rigid(target.T_world_cam) @ source.T_world_cam


def error_m(T_target_source: FloatArray, source: Frame, target: Frame) -> float:
    return float(np.linalg.norm(T_target_source[:3, 3] - truth(source, target)[:3, 3]))


def estimate(first: Frame, second: Frame, camera: Intrinsics = SMALL) -> FloatArray | None:
    return PhotometricOdometry(camera).estimate(first, second)


@pytest.mark.parametrize("camera", [SMALL, LARGE], ids=["320x180", "640x360"])
@pytest.mark.parametrize(("x", "y", "yaw"), [(STEP_M, 0.0, 0.0), (0.08, 0.087, 0.02)])
def test_a_step_is_measured_within_a_centimetre(camera: Intrinsics, x: float, y: float, yaw: float) -> None:
    first, second = frame(camera), frame(camera, x, y, yaw, seed=2)
    T = estimate(first, second, camera)
    assert error_m(T, first, second) < 0.01
    np.testing.assert_allclose(T[:3, :3], truth(first, second)[:3, :3], atol=0.002)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-6)
    np.testing.assert_array_equal(T[3], [0, 0, 0, 1])
    np.testing.assert_array_equal(T, estimate(first, second, camera), err_msg="not the same every time")
    np.testing.assert_allclose(T @ estimate(second, first, camera), np.eye(4), atol=0.01, err_msg="there and back")


@pytest.mark.parametrize("gain", [0.7, 1.3])
def test_a_change_of_exposure_does_not_matter(gain: float) -> None:
    first, second = frame(gain=0.7), frame(x=STEP_M, seed=2, gain=0.7 * gain)
    assert error_m(estimate(first, second), first, second) < 0.01


def test_a_camera_that_rests_does_not_move() -> None:
    np.testing.assert_allclose(estimate(frame(seed=1), frame(seed=2)), np.eye(4), atol=1e-3)


@pytest.mark.parametrize("camera", [SMALL, LARGE], ids=["320x180", "640x360"])
def test_a_cut_to_another_scene_is_a_failure(camera: Intrinsics) -> None:
    assert estimate(frame(camera), frame(camera, room=1, seed=2), camera) is None


def test_an_image_that_no_motion_explains_fails_by_its_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    first = frame()
    torn = first.gray.reshape(6, 30, 320).copy()
    torn[::2], torn[1::2] = np.roll(torn[::2], 4, axis=2), np.roll(torn[1::2], -4, axis=2)
    second = Frame(stamp_s=2, gray=torn.reshape(180, 320), depth_m=first.depth_m)
    assert estimate(first, second) is None
    monkeypatch.setattr(parts, "MAX_RESIDUAL_PX", 1e9)
    assert estimate(first, second) is not None


@pytest.mark.parametrize(("bound", "is_found"), [(0.3, False), (0.1, True)])
def test_a_target_with_little_depth_fails_by_its_overlap(
    bound: float, is_found: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = frame(), frame(x=STEP_M, seed=2)
    blind = second.depth_m.copy()
    blind[:, 70:] = 0  # 70 of 320 columns
    monkeypatch.setattr(parts, "MIN_OVERLAP", bound)
    T = estimate(first, Frame(stamp_s=2, gray=second.gray, depth_m=blind))
    assert (T is not None) == is_found


@pytest.mark.parametrize(("bound", "value"), [("MAX_TRANSLATION_M", 0.05), ("MAX_ROTATION_DEG", 1.0)])
def test_motion_beyond_the_bound_is_too_far(bound: str, value: float, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = frame(), frame(x=STEP_M, yaw=0.05, seed=2)
    assert estimate(first, second) is not None
    monkeypatch.setattr(parts, bound, value)
    assert estimate(first, second) is None


def test_black_images_and_images_without_depth_are_not_solved() -> None:
    seen = frame()
    black = Frame(stamp_s=1, gray=np.zeros_like(seen.gray), depth_m=seen.depth_m)
    flat = Frame(stamp_s=1, gray=seen.gray, depth_m=np.zeros_like(seen.depth_m))
    for pair in ((black, black), (seen, black), (black, seen), (flat, flat), (seen, flat), (flat, seen)):
        assert estimate(*pair) is None


@pytest.mark.parametrize(("size", "is_found"), [((32, 24), False), ((33, 200), False), ((640, 480), True)])
def test_any_size_of_image_is_taken_and_too_small_a_one_is_not_solved(size: tuple[int, int], is_found: bool) -> None:
    camera = Intrinsics.from_hfov(width_px=size[0], height_px=size[1], hfov_deg=86)
    T = estimate(frame(camera, holes=0), frame(camera, x=0.02, holes=0, seed=2), camera)
    assert (T is not None) == is_found


def test_priors_map_the_source_camera_into_the_target_camera() -> None:
    ahead = motion_between(frame(), frame(x=STEP_M, seed=2), PhotometricOdometry(SMALL)) @ [0, 0, 3, 1]
    np.testing.assert_allclose(ahead, [0, 0, 3 - STEP_M, 1], atol=1e-12)


def moved(x: float, yaw_deg: float = 0.0) -> FloatArray:
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    return np.array([[c, 0, s, x], [0, 1, 0, 0], [-s, 0, c, 0], [0, 0, 0, 1]])


def bare(number: int = 0, T_world_cam: FloatArray | None = None) -> Frame:
    gray = np.zeros((2, 2), np.uint8)
    return Frame(stamp_s=float(number), gray=gray, depth_m=gray.astype(np.float32), T_world_cam=T_world_cam)


class Growing:
    """Frame i and i + 1 are i + 1 metres apart; fails at the given pairs."""

    def __init__(self, *fails_at: int) -> None:
        self.fails_at = fails_at
        self.requested: list[int] = []

    def estimate(self, source: Frame, target: Frame) -> FloatArray | None:
        i = int(source.stamp_s)
        self.requested.append(i)
        return None if i in self.fails_at else moved(i + 1.0)


@pytest.mark.parametrize(("first", "second"), [(None, moved(0)), (moved(0), None), (None, None)])
def test_without_poses_of_both_frames_odometry_is_asked(first: FloatArray | None, second: FloatArray | None) -> None:
    odometry = Growing()
    np.testing.assert_array_equal(motion_between(bare(0, first), bare(1, second), odometry), moved(1.0))
    assert odometry.requested == [0]


@pytest.mark.parametrize("there", [moved(4.0), moved(1.0, 90.0)])
def test_poses_go_before_odometry_but_not_where_they_jump(there: FloatArray) -> None:
    odometry = Growing()
    T = motion_between(bare(0, moved(1.0)), bare(1, moved(1.2)), odometry)
    np.testing.assert_allclose(T, moved(-0.2), atol=1e-12)
    assert motion_between(bare(0, moved(1.0)), bare(1, there), odometry) is None
    assert not odometry.requested


@pytest.mark.parametrize(
    ("n", "fails_at", "x_m", "requested"),
    [(4, (), [3, 2, 1, 0], [0]), (3, (0,), [None, None, 0], [0]), (1, (), [0], [])],
)
def test_the_frames_of_a_window_are_placed_before_the_last(
    n: int, fails_at: tuple[int, ...], x_m: list[float | None], requested: list[int]
) -> None:
    odometry = Growing(*fails_at)
    poses = poses_in_last([bare(i) for i in range(n)], odometry)
    assert [None if T is None else float(T[0, 3]) for T in poses] == x_m
    assert odometry.requested == requested
