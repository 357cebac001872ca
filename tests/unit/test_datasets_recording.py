"""Recordings: what the simulator's writer wrote reads back as frames without truth, and damage is found."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sim.recording import RecordingWriter
from sim.types import Capture
from tests.sequences import CAMERA as SHARED_CAMERA
from tests.sequences import write_images
from tests.unit.test_recording_format import any_capture
from voxdepth.checksums import LIST
from voxdepth.datasets import open_dataset
from voxdepth.datasets.recording import RecordingDataset
from voxdepth.errors import DatasetError

CAMERA = replace(SHARED_CAMERA, baseline_m=0.095)
N = 3
TRUTH = ("gray_right", "depth_true", "occluded", "segment", "invalid_reason")


def capture_of(index: int) -> Capture:
    return any_capture(index, 0.1 + index / 3, CAMERA)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with RecordingWriter(tmp_path / "run", intrinsics=CAMERA, config_text="seed = 1\n") as writer:
        for index in range(N):
            writer.append(capture_of(index))
    (tmp_path / "run" / LIST).unlink()  # As of an earlier version: damage has to be found by what a file holds.
    return tmp_path / "run"


def test_frames_are_what_the_camera_measured_and_nothing_else(folder: Path) -> None:
    dataset = open_dataset(folder)
    assert isinstance(dataset, RecordingDataset) and len(dataset) == N and dataset.intrinsics == CAMERA
    for index in range(N):
        frame, capture = dataset[index], capture_of(index)
        assert frame.stamp_s == capture.stamp_s and dataset.name(index) == f"{index:06d}"
        assert np.array_equal(frame.gray, capture.gray_left) and np.array_equal(frame.depth_m, capture.depth_raw_m)
        assert frame.T_world_cam is None


def test_truth_is_not_needed(folder: Path) -> None:
    for name in TRUTH:
        shutil.rmtree(folder / name)
    assert np.array_equal(open_dataset(folder)[N - 1].depth_m, capture_of(N - 1).depth_raw_m)


def test_a_row_that_is_still_being_written_is_left_out(folder: Path) -> None:
    table = folder / "frames.csv"
    table.write_bytes(table.read_bytes()[:-1])
    assert len(open_dataset(folder)) == N - 1


@pytest.mark.parametrize("name", ["gray_left/000001.png", "depth_raw/000001.tiff"])
def test_a_damaged_or_missing_image_stops_only_its_frame(folder: Path, name: str) -> None:
    path = folder / name
    path.write_bytes(path.read_bytes()[:20])
    dataset = open_dataset(folder)
    with pytest.raises(DatasetError, match=name):
        dataset[1]
    path.unlink()
    with pytest.raises(DatasetError, match=rf"{name}, got none"):
        dataset[1]
    assert dataset[2].stamp_s == capture_of(2).stamp_s


@pytest.mark.parametrize(("value", "message"), [(-1.0, "not negative"), (1500.0, "got 1500 m .*state units_per_m")])
def test_depth_that_no_camera_measures_is_refused(folder: Path, value: float, message: str) -> None:
    write_images(folder, {"depth_raw/000000.tiff": np.full(CAMERA.shape, value, np.float32)})
    with pytest.raises(DatasetError, match=rf"depth_raw/000000\.tiff give no frame: .*{message}"):
        open_dataset(folder)[0]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("timestamp_s", "time", "first line of .*frames.csv"),
        ("\n0.1,", "\n", "line 2 of .*frames.csv"),
        ("\n0.1,", "\nnoon,", "line 2 of .*frames.csv"),
        (None, "", "expected frames in .*run, got none"),
    ],
)
def test_a_damaged_table_is_refused(folder: Path, old: str | None, new: str, message: str) -> None:
    path = folder / "frames.csv"
    assert old is None or old in path.read_text()
    path.write_text(new if old is None else path.read_text().replace(old, new, 1))
    with pytest.raises(DatasetError, match=message):
        open_dataset(folder)
