"""Depth cameras for the images of any renderer."""

import runpy
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim.depth_camera import CAMERAS, DepthCamera
from sim.errors import SensorError
from sim.sensor import RigConfig
from voxdepth.types import GrayImage

SMALL = RigConfig(width_px=320, height_px=180, rate_hz=30)


def plane(shape: tuple[int, int], disparity_px: int) -> tuple[GrayImage, GrayImage]:
    """The left and right image of a textured plane before a camera."""
    texture = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    left = np.asarray(cv2.GaussianBlur(texture, (3, 3), 0), np.uint8)
    return left, np.roll(left, -disparity_px, axis=1)


@pytest.mark.parametrize("name", list(CAMERAS))
def test_every_named_camera_measures_a_plane(name: str) -> None:
    camera = DepthCamera(name, seed=0)
    measured = camera.from_pair(*plane(camera.intrinsics.shape, 20), frame=0)
    disparity_px = camera.intrinsics.focal_baseline_px_m / measured.depth_raw_m[measured.depth_raw_m > 0]
    assert np.median(disparity_px) == pytest.approx(20, abs=0.1)
    assert (measured.depth_raw_m > 0).mean() > 0.9
    assert measured.intrinsics == CAMERAS[name].intrinsics


def test_a_pair_is_matched() -> None:
    camera = DepthCamera(SMALL, seed=0)
    measured = camera.from_pair(*plane(camera.intrinsics.shape, 6), frame=4)
    valid = measured.depth_raw_m > 0
    assert valid.mean() > 0.7
    assert np.median(measured.depth_raw_m[valid]) == pytest.approx(camera.intrinsics.focal_baseline_px_m / 6, rel=0.02)
    assert measured.stamp_s == pytest.approx(4 / 30)
    assert np.isinf(measured.depth_true_m).all()


def test_the_same_frame_has_the_same_noise_and_another_one_has_other_noise() -> None:
    gray, _ = plane(SMALL.full_intrinsics.shape, 0)

    def noisy(seed: int, frame: int) -> np.ndarray:
        return DepthCamera(SMALL, seed=seed).from_pair(gray, gray, frame=frame).gray_left

    np.testing.assert_array_equal(noisy(3, 1), noisy(3, 1))
    for seed, frame in ((3, 2), (4, 1)):
        assert (noisy(seed, frame) != noisy(3, 1)).mean() > 0.5


def test_what_does_not_fit_is_refused_with_what_to_do() -> None:
    camera, gray = DepthCamera(SMALL, seed=0), np.zeros((180, 320), np.uint8)
    with pytest.raises(SensorError, match=r"a gray image must be uint8 of shape \(180, 320\), got uint8 of shape"):
        camera.from_pair(gray[:90], gray, frame=0)
    with pytest.raises(SensorError, match="got uint16 of shape"):
        camera.from_pair(gray, gray.astype(np.uint16), frame=0)
    with pytest.raises(SensorError, match="there is no camera 'kinect'; choose one of d435"):
        DepthCamera("kinect", seed=0)
    for change in ({"projected_texture": 0.4}, {"color_offset_m": 0.02}, {"shutter": 0.5}, {"depth": "truth"}):
        with pytest.raises(SensorError, match="can only be matched"):
            DepthCamera(SMALL.model_copy(update=change), seed=0)


def test_the_example_writes_the_depth_of_two_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plane in front of cameras 0.1 m apart with f = 160 px has a disparity of 8 px at 2 m."""
    for name, image in zip(("left", "right"), plane((120, 320), 8), strict=True):
        cv2.imwrite(str(tmp_path / f"{name}.png"), image)
    example = Path(__file__).parents[2] / "examples/depth_of_a_pair.py"
    options = ["left.png", "right.png", "--hfov", "90", "--baseline", "0.1", "--out", "depth.png"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(example), *options])
    runpy.run_path(str(example), run_name="__main__")
    assert "of the pixels have a depth: depth.png" in capsys.readouterr().out
    depth_mm = cv2.imread(str(tmp_path / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert np.median(depth_mm[depth_mm > 0]) == pytest.approx(2000, rel=0.01)
