"""Recordings: what the simulator's writer wrote reads back as frames without truth, and damage is found."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim import frames
from sim.recording import RecordingWriter
from sim.types import Capture
from voxdepth.datasets import open_dataset
from voxdepth.datasets.recording import RecordingDataset
from voxdepth.errors import DatasetError
from voxdepth.types import Intrinsics

CAMERA = Intrinsics(fx_px=9, fy_px=9, cx_px=4, cy_px=3, width_px=9, height_px=7, baseline_m=0.095)
N = 3
TRUTH = ("gray_right", "depth_true", "occluded", "segment", "invalid_reason")


def capture_of(index: int) -> tuple[Capture, np.ndarray]:
    rng = np.random.default_rng(index)
    depth_raw_m = rng.uniform(0.5, 40, CAMERA.shape).astype(np.float32)
    depth_raw_m[rng.random(CAMERA.shape) < 0.2] = 0
    q = np.array([0.0, 0.0, 0.6, 0.8])
    capture = Capture(
        stamp_s=0.1 + index / 3,
        drone=0,
        gray_left=rng.integers(0, 256, CAMERA.shape, np.uint8),
        gray_right=rng.integers(0, 256, CAMERA.shape, np.uint8),
        depth_true_m=rng.uniform(0.5, 40, CAMERA.shape).astype(np.float32),
        depth_raw_m=depth_raw_m,
        occluded=rng.random(CAMERA.shape) < 0.5,
        invalid_reason=rng.integers(0, 7, CAMERA.shape, np.uint8),
        segment_id=rng.integers(-1, 50, CAMERA.shape, np.int32),
        T_world_cam=frames.pose(frames.rotation_from_quaternion(q), np.ones(3)),
        intrinsics=CAMERA,
    )
    return capture, q


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    with RecordingWriter.create(tmp_path / "run", intrinsics=CAMERA, config_text="seed = 1\n") as writer:
        for index in range(N):
            writer.append(*capture_of(index))
    return tmp_path / "run"


def test_frames_are_what_the_camera_measured_and_nothing_else(folder: Path) -> None:
    dataset = open_dataset(folder)
    assert isinstance(dataset, RecordingDataset) and len(dataset) == N and dataset.intrinsics == CAMERA
    for index in range(N):
        frame, capture = dataset[index], capture_of(index)[0]
        assert frame.stamp_s == capture.stamp_s and dataset.name(index) == f"{index:06d}"
        assert np.array_equal(frame.gray, capture.gray_left) and np.array_equal(frame.depth_m, capture.depth_raw_m)
        assert frame.T_world_cam is None


def test_truth_is_not_needed(folder: Path) -> None:
    for name in TRUTH:
        shutil.rmtree(folder / name)
    assert np.array_equal(open_dataset(folder)[N - 1].depth_m, capture_of(N - 1)[0].depth_raw_m)


def test_a_frame_that_was_not_committed_is_left_out(folder: Path) -> None:
    checksums = folder / "checksums.txt"
    whole = checksums.read_text()
    checksums.write_text(whole[:-1])
    assert len(open_dataset(folder)) == N - 1
    checksums.write_text(whole)
    poses = folder / "groundtruth.txt"
    poses.write_text(poses.read_text()[:-5])
    assert len(open_dataset(folder)) == N - 1


@pytest.mark.parametrize("name", ["gray_left/000001.png", "depth_raw/000001.tiff"])
def test_a_changed_or_missing_image_stops_only_its_frame(folder: Path, name: str) -> None:
    path = folder / name
    path.write_bytes(path.read_bytes() + b"x")
    dataset = open_dataset(folder)
    with pytest.raises(DatasetError, match=rf"{name} is damaged \(wrong checksum\)"):
        dataset[1]
    path.unlink()
    with pytest.raises(DatasetError, match=rf"expected a file .*{name}, got none"):
        dataset[1]
    assert dataset[2].stamp_s == capture_of(2)[0].stamp_s


@pytest.mark.parametrize("value", [np.nan, np.inf, -1.0])
def test_depth_that_no_camera_measures_is_refused_even_with_its_checksum(folder: Path, value: float) -> None:
    from hashlib import sha256

    path = folder / "depth_raw/000000.tiff"
    before = sha256(path.read_bytes()).hexdigest()
    cv2.imwrite(str(path), np.full(CAMERA.shape, value, np.float32))
    checksums = folder / "checksums.txt"
    checksums.write_text(checksums.read_text().replace(before, sha256(path.read_bytes()).hexdigest()))
    with pytest.raises(DatasetError, match=r"at least 0 in .*depth_raw/000000\.tiff"):
        open_dataset(folder)[0]


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("groundtruth.txt", "0.1", "0.2", "line 2 of .*groundtruth.txt is damaged"),
        ("groundtruth.txt", "# timestamp", "# time", "as the first line of"),
        ("checksums.txt", "  config.toml", " config.toml", "line 1 of .*checksums.txt"),
        ("checksums.txt", "  calibration.toml", "  calibration.tom", "expected a checksum of calibration.toml"),
        ("calibration.toml", "fx_px = 9.0", "fx_px = 8.0", "calibration.toml is damaged"),
    ],
)
def test_a_changed_list_is_refused(folder: Path, name: str, old: str, new: str, message: str) -> None:
    path = folder / name
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(DatasetError, match=message):
        open_dataset(folder)


def test_given_intrinsics_spare_a_damaged_calibration(folder: Path) -> None:
    (folder / "calibration.toml").write_bytes(b"\xff")
    assert len(open_dataset(folder, intrinsics=CAMERA)) == N


@pytest.mark.parametrize("name", ["groundtruth.txt", "checksums.txt"])
def test_a_list_of_binary_garbage_is_refused(folder: Path, name: str) -> None:
    (folder / name).write_bytes(b"\x80\n\xff\n")
    with pytest.raises(DatasetError, match=f"expected text in .*{name}"):
        open_dataset(folder)


def test_a_recording_without_a_whole_frame_is_refused(folder: Path) -> None:
    (folder / "checksums.txt").write_text("")
    with pytest.raises(DatasetError, match=r"checksum of calibration|expected frames"):
        open_dataset(folder)
    with pytest.raises(DatasetError, match=r"expected frames in .*run, got none"):
        open_dataset(folder, intrinsics=CAMERA)
