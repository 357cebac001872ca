"""Opening a dataset: the format is recognised by its files, and the camera comes from the nearest source."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.sequences import CAMERA, SHAPE, toml_of, write_images
from voxdepth.datasets import open_dataset
from voxdepth.errors import ConfigError, DatasetError, FrameError

CALIBRATED = replace(CAMERA, fx_px=7.0)
CALIBRATION = toml_of(CALIBRATED)
JSON = '{"width": 8, "height": 6, "intrinsic_matrix": [9, 0, 0, 0, 9, 0, 4, 3, 1]}'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    images = {"depth/000000.png": np.zeros(SHAPE, np.uint16), "color/000000.png": np.zeros(SHAPE, np.uint8)}
    write_images(tmp_path, images)
    (tmp_path / "camera_intrinsic.json").write_text(JSON)
    return tmp_path


def test_given_intrinsics_count_before_the_calibration_and_that_before_the_formats_own(folder: Path) -> None:
    assert open_dataset(folder).intrinsics.fx_px == 9
    (folder / "calibration.toml").write_text(CALIBRATION)
    assert open_dataset(folder).intrinsics == CALIBRATED
    assert open_dataset(folder, intrinsics=CAMERA).intrinsics is CAMERA


def test_a_calibration_of_optional_fields_alone_completes_the_camera_of_the_format(folder: Path) -> None:
    (folder / "calibration.toml").write_text("baseline_m = 0.095\ndisparity_scale = 2\n")
    camera = open_dataset(folder).intrinsics
    assert (camera.fx_px, camera.width_px, camera.baseline_m, camera.disparity_scale) == (9, 8, 0.095, 2)
    (folder / "camera_intrinsic.json").unlink()
    with pytest.raises(DatasetError, match=r"it lacks fx_px, .*, height_px: add these lines"):
        open_dataset(folder)


def test_a_given_unit_counts_before_the_calibration_and_that_before_the_formats_own(folder: Path) -> None:
    write_images(folder, {"depth/000000.png": np.full(SHAPE, 1000, np.uint16)})
    for expected_m, file, text in (
        (1.0, "calibration.toml", ""),
        (0.1, "camera_intrinsic.json", JSON.replace("}", ', "depth_scale": 10000}')),
        (0.2, "calibration.toml", "units_per_m = 5000\n"),
        (0.25, "calibration.toml", CALIBRATION + "units_per_m = 4000\n"),
    ):
        (folder / file).write_text(text)
        np.testing.assert_allclose(open_dataset(folder)[0].depth_m, expected_m, rtol=1e-6)
    assert open_dataset(folder).intrinsics.fx_px == 7
    np.testing.assert_allclose(open_dataset(folder, units_per_m=500)[0].depth_m, 2)
    with pytest.raises(FrameError, match="units_per_m must be a number"):
        open_dataset(folder, units_per_m=0.001)


@pytest.mark.parametrize("within_s", [-0.1, np.inf, np.nan])
def test_a_tolerance_that_makes_no_sense_is_refused(folder: Path, within_s: float) -> None:
    with pytest.raises(ConfigError, match="within_s must be a number of seconds"):
        open_dataset(folder, within_s=within_s)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("fx_px = 7.0", "fx_px = ", "no TOML"),
        ("fx_px = 7.0", "a = " + "[" * 5000, "no TOML"),
        ("fy_px", "fz_px", r"unknown key 'fz_px' \(did you mean f._px or f._px\?\); it lacks fy_px: add"),
        ("fx_px = 7.0", "fx_px = '7'", "fx_px must be a number, got '7'"),
        ("fx_px = 7.0", "fx_px = nan", "are they in pixels"),
        ("fx_px = 7.0", "fx_px" + ".a" * 5000 + " = 7", "no TOML .*more than 50 deep"),
        ("fx_px = 7.0", "fx_px.a.a = 7", "fx_px must be a number, got {'a': {'a': 7}}"),
        ("fx_px = 7.0", "fx_px = true", "fx_px must be a number"),
        ("width_px = 8", "width_px = 8.0", "width_px must be a whole number, got 8.0"),
        ("cx_px = 3.5", "cx_px = 320.0", "far outside of an image of 8x6"),
        ("width_px = 8", "width_px = 8\nunits_per_m = '1000'", "units_per_m must be a number of 1 to 1,000,000"),
    ],
)
def test_a_calibration_that_makes_no_sense_is_refused(folder: Path, old: str, new: str, message: str) -> None:
    assert old in CALIBRATION
    (folder / "calibration.toml").write_text(CALIBRATION.replace(old, new))
    with pytest.raises(DatasetError, match=message) as caught:
        open_dataset(folder)
    assert "calibration.toml" in str(caught.value)


def test_what_is_given_spares_a_damaged_calibration(folder: Path) -> None:
    (folder / "calibration.toml").write_bytes(b"\xff")
    assert len(open_dataset(folder, intrinsics=CAMERA, units_per_m=1)) == 1


def test_an_empty_folder_is_reported_what_every_format_needs(tmp_path: Path) -> None:
    with pytest.raises(DatasetError) as caught:
        open_dataset(tmp_path)
    message = str(caught.value)
    assert all(f"{name} lacks " in message for name in ("tum", "midair", "realsense", "recording", "bag"))
    assert all(word in message for word in ("rgb.txt", "depth", "frames.csv"))


def test_a_file_or_nothing_in_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    for name, message in (
        ("file", r"file is a file; name the folder"),
        ("none", r"there is no folder .*none"),
        ("a\0b", r"cannot look into|there is no folder"),
        ("x" * 5000, r"cannot look into|there is no folder"),
    ):
        with pytest.raises(DatasetError, match=message):
            open_dataset(tmp_path / name)


@pytest.mark.parametrize(("call", "message"), [("iterdir", "cannot list"), ("exists", "cannot look into")])
def test_a_folder_that_may_not_be_read_is_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch, call: str, message: str
) -> None:
    def refuse(path: Path) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, call, refuse)
    with pytest.raises(DatasetError, match=f"{message} .*Permission denied"):
        open_dataset(folder)
