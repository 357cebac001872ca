"""Recorded sequences that were damaged give frames, or one line that says what is wrong."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.recording import RecordingWriter
from sim.types import Capture
from tests.bags import S, camera_info, image, images, write_bag
from tests.fuzz.damage import apply, path_damages
from tests.fuzz.fuzzing import fuzzed, in_time, require_clear
from voxdepth.datasets import DATASET_FORMATS, open_dataset
from voxdepth.errors import VoxDepthError
from voxdepth.types import Frame, Intrinsics

CAMERA = Intrinsics(fx_px=9, fy_px=9, cx_px=5, cy_px=4, width_px=10, height_px=8, baseline_m=0.1)
N = 3
CALIBRATION = "fx_px = 9.0\nfy_px = 9.0\ncx_px = 5.0\ncy_px = 4.0\nwidth_px = 10\nheight_px = 8\n"


def gray_of(index: int) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 256, CAMERA.shape, np.uint8)


def depth_of(index: int) -> np.ndarray:
    return np.random.default_rng(50 + index).integers(0, 65536, CAMERA.shape, np.uint16)


def write_recording(folder: Path) -> None:
    with RecordingWriter(folder, intrinsics=CAMERA, config_text="seed = 1\n") as writer:
        for index in range(N):
            rng = np.random.default_rng(index)
            capture = Capture(
                stamp_s=0.1 + index / 3,
                drone=0,
                gray_left=gray_of(index),
                gray_right=gray_of(index),
                depth_true_m=depth_of(index).astype(np.float32) / 1000,
                depth_raw_m=depth_of(index).astype(np.float32) / 1000,
                occluded=rng.random(CAMERA.shape) < 0.5,
                invalid_reason=rng.integers(0, 7, CAMERA.shape, np.uint8),
                segment_id=rng.integers(-1, 50, CAMERA.shape, np.int32),
                T_world_cam=frames.pose(frames.rotation_from_yaw(0.3), np.ones(3)),
                intrinsics=CAMERA,
            )
            writer.append(capture)


def write_tum(folder: Path) -> None:
    for name, pixels in (("rgb", gray_of), ("depth", depth_of)):
        (folder / name).mkdir(parents=True)
        stamps = [f"{1 + index / 30:.6f}" for index in range(N)]
        for index, stamp in enumerate(stamps):
            cv2.imwrite(str(folder / f"{name}/{stamp}.png"), pixels(index))
        (folder / f"{name}.txt").write_text("# a comment\n" + "".join(f"{s} {name}/{s}.png\n" for s in stamps))
    (folder / "calibration.toml").write_text(CALIBRATION)


def write_realsense(folder: Path) -> None:
    """Write what `rs-convert -r` does: files with the time of the frame in their names."""
    folder.mkdir(parents=True)
    for index in range(N):
        stamp_ms = 1000 + 33 * index
        depth_of(index).tofile(folder / f"walk_Depth_{stamp_ms}.raw")
        cv2.imwrite(str(folder / f"walk_Infrared 1_{stamp_ms}.png"), gray_of(index))
    (folder / "calibration.toml").write_text(CALIBRATION)


def bag(name: str, plugin: str = "sqlite3") -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        folder.mkdir()
        headers = [(S + index * S // 30, "left") for index in range(N)]
        depth = images("/depth", [image(depth_of(i), "16UC1", header) for i, header in enumerate(headers)])
        gray = images("/gray", [image(gray_of(i), "mono8", header) for i, header in enumerate(headers)])
        infos = images("/camera_info", [camera_info(CAMERA, header) for header in headers], "CameraInfo")
        write_bag(folder / name, depth + gray + infos, plugin)

    return write


WRITERS: dict[str, Callable[[Path], None]] = {
    "recording": write_recording,
    "tum": write_tum,
    "realsense": write_realsense,
    "ros1": bag("walk.bag"),
    "db3": bag("walk.db3"),
    "mcap": bag("walk.mcap"),
    "folder of db3": bag("walk"),
    "folder of mcap": bag("walk", "mcap"),
}
INSIDE = {"folder of db3": "walk", "folder of mcap": "walk"}
"""What is opened in the folder."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("whole")
    for name, write in WRITERS.items():
        write(folder / name)
    return folder


def read(path: Path, format: str) -> list[Frame]:
    """Read all frames, the later ones first as well as in order."""
    dataset = open_dataset(path, format)
    indices = range(len(dataset))
    assert len({dataset.name(index) for index in indices}) == len(indices)
    assert all(dataset.header(index).stamp_ns >= -(2**80) for index in indices)
    frames = []
    for index in [*indices, *reversed(indices)]:
        with clear_if_refused():  # One frame may be lost, and the others are still there.
            frame = dataset[index]
            assert frame.depth_m.shape == dataset.intrinsics.shape and np.isfinite(frame.stamp_s)
            frames.append(frame)
    return frames


@contextmanager
def clear_if_refused() -> Iterator[None]:
    try:
        yield
    except VoxDepthError as error:
        require_clear(error)


@pytest.mark.parametrize("kind", sorted(WRITERS))
def test_what_is_whole_is_read(whole: Path, kind: str) -> None:
    assert len(read(whole / kind / INSIDE.get(kind, ""), "auto")) == 2 * N


@pytest.mark.slow
@fuzzed(1000)
@given(
    kind=st.sampled_from(sorted(WRITERS)),
    harm=st.lists(st.tuples(path_damages, st.integers(0, 2**16)), min_size=1, max_size=3),
    format=st.sampled_from(["auto", "auto", "auto", *DATASET_FORMATS]),
)
def test_a_damaged_sequence_gives_frames_or_one_line(
    whole: Path,
    tmp_path_factory: pytest.TempPathFactory,
    kind: str,
    harm: list[tuple[Callable[[Path], None], int]],
    format: str,
) -> None:
    folder = tmp_path_factory.getbasetemp() / "damaged"
    with in_time(), clear_if_refused():
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(whole / kind, folder)
        for damage, choice in harm:
            apply(damage, folder, choice)
        read(folder / INSIDE.get(kind, ""), format)
