"""Depth cameras for the images of any renderer."""

import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.bodies import Body
from sim.depth_camera import CAMERA_NAMES, CAMERAS, DepthCamera, seen_from_right
from sim.errors import SensorError
from sim.render import create_renderer
from sim.sensor import RigConfig
from sim.types import Images, InvalidReason
from tests.helpers import block, camera_at, wall, world_of

SMALL = RigConfig(width_px=320, height_px=180, rate_hz=30)


def rendered(*bodies: Body) -> tuple[Images, Images]:
    """The images of a pair of the small camera."""
    with world_of(*bodies) as world:
        cameras = [camera_at(0, side * SMALL.baseline_m / 2, 0, intrinsics=SMALL.full_intrinsics) for side in (1, -1)]
        left, right = create_renderer("raster", world).render(cameras)
    return left, right


@pytest.mark.parametrize("name", CAMERA_NAMES)
def test_every_named_camera_measures_a_plane(name: str) -> None:
    camera = DepthCamera(name, seed=0)  # type: ignore[arg-type]
    depth_m = np.full(camera.intrinsics.shape, 2.0, np.float32)
    measured = camera.from_depth(depth_m, frame=0)
    valid = measured.depth_raw_m > 0
    assert valid.mean() > 0.85
    error_px = camera.intrinsics.focal_baseline_px_m * (1 / measured.depth_raw_m[valid] - 0.5)
    assert np.std(error_px) == pytest.approx(0.1, rel=0.05)
    assert measured.intrinsics == CAMERAS[name].intrinsics  # type: ignore[index]


def test_a_pair_is_matched() -> None:
    left, right = rendered(wall(3.0))
    measured = DepthCamera(SMALL, seed=0).from_pair(left.gray, right.gray, frame=4)
    valid = measured.depth_raw_m > 0
    assert valid.mean() > 0.7
    assert np.median(measured.depth_raw_m[valid]) == pytest.approx(3.0, abs=0.2)
    assert measured.stamp_s == pytest.approx(4 / 30)
    assert np.isinf(measured.depth_true_m).all()


def test_true_depth_names_the_reasons_for_holes_and_changes_no_depth() -> None:
    left, right = rendered(wall(4.0), block(2.0, 0.8))
    camera = DepthCamera(SMALL, seed=0)
    alone = camera.from_pair(left.gray, right.gray, frame=0)
    shadows = []
    for right_depth_m in (right.depth_m, None):
        told = camera.from_pair(left.gray, right.gray, frame=0, depth_m=left.depth_m, right_depth_m=right_depth_m)
        np.testing.assert_array_equal(alone.depth_raw_m > 0, told.depth_raw_m > 0)
        shadows.append(told.invalid_reason == InvalidReason.OCCLUDED)
    assert shadows[0].sum() > 100
    assert (shadows[0] & shadows[1]).sum() > 0.9 * (shadows[0] | shadows[1]).sum()


def test_a_camera_that_cannot_match_pairs_measures_true_depth() -> None:
    noisy = SMALL.model_copy(update={"depth": "noisy", "photon_sigma": 3.0})
    camera = DepthCamera(noisy, seed=0)
    assert (camera.from_depth(np.full(noisy.full_intrinsics.shape, 5.0, np.float32), frame=0).depth_raw_m > 0).any()
    gray = np.zeros(noisy.full_intrinsics.shape, np.uint8)
    with pytest.raises(SensorError, match="photon noise"):
        camera.from_pair(gray, gray, frame=0)


def test_the_second_camera_misses_what_it_misses_in_a_renderer() -> None:
    left, right = rendered(wall(4.0), block(2.0, 0.8))
    guessed_m = seen_from_right(left.depth_m, SMALL.full_intrinsics)
    seen = np.isfinite(guessed_m)
    assert seen.mean() > 0.9
    assert (np.abs(guessed_m - right.depth_m)[seen] < 0.05).mean() > 0.97
    measured = DepthCamera(SMALL, seed=0).from_depth(left.depth_m, frame=0)
    hidden = measured.invalid_reason == InvalidReason.OCCLUDED
    assert 0.005 < hidden.mean() < 0.1


def test_the_same_frame_has_the_same_noise_and_another_one_has_other_noise() -> None:
    depth_m = np.full(SMALL.full_intrinsics.shape, 5.0, np.float32)
    one, same = (DepthCamera(SMALL, seed=3).from_depth(depth_m, frame=1).depth_raw_m for _ in range(2))
    np.testing.assert_array_equal(one, same)
    for seed, frame in ((3, 2), (4, 1)):
        assert (DepthCamera(SMALL, seed=seed).from_depth(depth_m, frame=frame).depth_raw_m != one).mean() > 0.5


def test_no_surface_may_be_told_by_zero_or_infinity() -> None:
    depth_m = np.full(SMALL.full_intrinsics.shape, np.inf, np.float32)
    for nothing in (np.inf, 0.0):
        depth_m[:] = nothing
        measured = DepthCamera(SMALL, seed=0).from_depth(depth_m, frame=0)
        assert np.isinf(measured.depth_true_m).all()


@pytest.mark.parametrize("decimate", [1, 4])
@pytest.mark.parametrize("unmeasured", [-np.inf, np.nan])
def test_what_cannot_be_measured_has_no_depth_and_changes_none_beside_it(unmeasured: float, decimate: int) -> None:
    camera = DepthCamera(SMALL.model_copy(update={"decimate": decimate}), seed=0)
    depth_m = np.full(SMALL.full_intrinsics.shape, 4.0, np.float32)
    depth_m[60:120, 100:200] = unmeasured
    measured = camera.from_depth(depth_m, frame=0)
    inside = np.zeros(depth_m.shape, np.bool_)
    inside[60:120, 100:200] = True
    inside = inside[decimate // 2 :: decimate, decimate // 2 :: decimate]
    assert not measured.depth_raw_m[inside].any()
    assert (measured.invalid_reason[inside] == InvalidReason.OUT_OF_RANGE).all()
    beside_m = measured.depth_raw_m[~inside]
    assert (np.abs(beside_m[beside_m > 0] - 4) < 1).all() and (beside_m > 0).mean() > 0.8
    casts_shadow = measured.occluded[~inside].mean() > 0.025
    assert casts_shadow == np.isinf(unmeasured), "only what is known to be near hides what is behind it"


def test_a_negative_true_depth_is_refused() -> None:
    true_m = np.full(SMALL.full_intrinsics.shape, 4.0, np.float32)
    true_m[3, 4] = -1e-3
    with pytest.raises(SensorError, match=r"a true depth is at least 0 m, got -.* give 0 or \+inf"):
        DepthCamera(SMALL, seed=0).from_depth(true_m, frame=0)


def test_what_does_not_fit_is_refused_with_what_to_do() -> None:
    camera, gray = DepthCamera(SMALL, seed=0), np.zeros((180, 320), np.uint8)
    with pytest.raises(SensorError, match=r"the gray image must be uint8 of shape \(180, 320\), got uint8 of shape"):
        camera.from_pair(gray[:90], gray, frame=0)
    with pytest.raises(SensorError, match="the depth image must be float32"):
        camera.from_depth(np.ones((180, 320)), frame=0)  # type: ignore[arg-type]
    with pytest.raises(SensorError, match="there is no camera 'kinect'; choose one of d435"):
        DepthCamera("kinect", seed=0)  # type: ignore[arg-type]
    lit = DepthCamera(SMALL.model_copy(update={"projected_texture": 0.4}), seed=0)
    with pytest.raises(SensorError, match="give depth_m and right_depth_m"):
        lit.from_pair(gray, gray, frame=0)
    with pytest.raises(SensorError, match="measures nothing"):
        DepthCamera(SMALL.model_copy(update={"depth": "truth"}), seed=0)


def test_the_example_writes_the_depth_of_two_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plane in front of cameras 0.1 m apart with f = 160 px has a disparity of 8 px at 2 m."""
    left = cv2.GaussianBlur(np.random.default_rng(0).integers(0, 256, (120, 320), dtype=np.uint8), (3, 3), 0)
    cv2.imwrite(str(tmp_path / "left.png"), left)
    cv2.imwrite(str(tmp_path / "right.png"), np.roll(left, -8, axis=1))
    example = Path(__file__).parents[2] / "examples/depth_of_a_pair.py"
    options = ["left.png", "right.png", "--hfov", "90", "--baseline", "0.1", "--out", "depth.png"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example), *options])
    runpy.run_path(str(example), run_name="__main__")
    assert "of the pixels have a depth: depth.png" in capsys.readouterr().out
    depth_mm = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert np.median(depth_mm[depth_mm > 0]) == pytest.approx(2000, rel=0.01)
