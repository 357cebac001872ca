"""Laws of recordings on disk: what was written reads back, and a recording is whole or absent."""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.errors import RecordingError
from sim.recording import Recording, RecordingWriter
from sim.types import Capture
from voxdepth.checksums import LIST
from voxdepth.types import Intrinsics

SMALL = Intrinsics(
    fx_px=4 / 3, fy_px=0.1 + 0.2, cx_px=np.pi / 10, cy_px=1e-17, width_px=9, height_px=7, baseline_m=0.0949999999999999
)
CONFIG = "seed = 3\r\n# Straße\n"
N = 4
FOLDERS = ("gray_left", "gray_right", "depth_raw", "depth_true", "occluded", "segment", "invalid_reason")
HEADER = b"timestamp_s,r11,r12,r13,tx_m,r21,r22,r23,ty_m,r31,r32,r33,tz_m\n"


def any_capture(seed: int, stamp_s: float, intrinsics: Intrinsics = SMALL) -> Capture:
    """Noise in every channel: depths of any bits at all, truth without surfaces, ids from -1 to the largest."""
    rng = np.random.default_rng(seed)
    shape = intrinsics.shape
    true = rng.integers(0, 2**32, shape, np.uint32).view(np.float32)
    true[rng.random(shape) < 0.2] = np.inf
    raw = rng.uniform(0.5, 40, shape).astype(np.float32)
    raw[rng.random(shape) < 0.2] = 0
    segment = rng.integers(-1, 2**16 - 1, shape, np.int32)
    segment.flat[0], segment.flat[-1] = 2**16 - 2, -1
    q = rng.normal(size=4)
    q /= np.linalg.norm(q)
    return Capture(
        stamp_s=stamp_s,
        drone=0,
        gray_left=rng.integers(0, 256, shape, np.uint8),
        gray_right=rng.integers(0, 256, shape, np.uint8),
        depth_true_m=true,
        depth_raw_m=raw,
        occluded=rng.random(shape) < 0.5,
        invalid_reason=rng.integers(0, 7, shape, np.uint8),
        segment_id=segment,
        T_world_cam=frames.pose(frames.rotation_from_quaternion(q), rng.normal(scale=100, size=3)),
        intrinsics=intrinsics,
    )


FRAMES = [any_capture(k, k / 30) for k in range(N)]


def writer_of(folder: Path) -> RecordingWriter:
    return RecordingWriter(folder, intrinsics=SMALL, config_text=CONFIG)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def same(a: Capture, b: Capture) -> bool:
    """Equal to the last bit, types included."""

    def bits(value: object) -> object:
        return (value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value

    return all(bits(getattr(a, field.name)) == bits(getattr(b, field.name)) for field in fields(Capture))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recordings") / "whole"
    with writer_of(folder) as writer:
        for capture in FRAMES:
            writer.append(capture)
    return folder


@contextmanager
def copy_of(folder: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as temporary:
        yield shutil.copytree(folder, Path(temporary) / "recording")


@given(st.integers(0, 2**32), st.integers(1, 12), st.integers(1, 12), st.floats(allow_nan=False, allow_infinity=False))
def test_what_was_written_reads_back_to_the_last_bit(seed: int, width: int, height: int, stamp_s: float) -> None:
    intrinsics = replace(SMALL, width_px=width, height_px=height)
    capture = any_capture(seed, stamp_s, intrinsics)
    with tempfile.TemporaryDirectory() as folder:
        with RecordingWriter(Path(folder), intrinsics=intrinsics, config_text=CONFIG) as writer:
            writer.append(capture)
        recording = Recording.open(Path(folder))
        assert recording.intrinsics == intrinsics
        assert recording.config_text == CONFIG
        assert len(recording) == 1
        assert same(recording[0], capture)
        assert same(recording[-1], capture)
        with pytest.raises(IndexError):
            recording[1]


def test_the_table_has_the_time_and_the_pose_of_every_frame(whole: Path) -> None:
    rows = np.loadtxt(whole / "frames.csv", delimiter=",", skiprows=1)
    for row, capture in zip(rows, FRAMES, strict=True):
        np.testing.assert_array_equal(row, [capture.stamp_s, *capture.T_world_cam[:3].ravel()])


def test_images_that_are_written_in_threads_give_the_same_files(tmp_path: Path, whole: Path) -> None:
    with writer_of(tmp_path / "threads") as writer, ThreadPoolExecutor(N) as pool:
        list(pool.map(writer.write_images, range(N), FRAMES))
        for capture in FRAMES:
            writer.append_row(capture)
    assert contents(tmp_path / "threads") == contents(whole)


def test_a_capture_of_one_camera_is_refused(tmp_path: Path) -> None:
    with writer_of(tmp_path / "r") as writer, pytest.raises(RecordingError, match="got none: let the sensor render"):
        writer.append(replace(FRAMES[0], gray_right=None))


def test_foreign_files_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    for folder, message in ((tmp_path, "is not empty"), (tmp_path / "thesis.txt", "Not a directory")):
        with pytest.raises(RecordingError, match=message), writer_of(folder):
            pass
    assert contents(tmp_path) == {"thesis.txt": b"mine"}


def test_a_recording_that_was_stopped_is_absent(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt), writer_of(tmp_path / "r") as writer:
        writer.append(FRAMES[0])
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("taken", [0, len(FOLDERS), 2 * len(FOLDERS) + 2])
def test_without_room_on_the_disk_a_recording_is_absent(
    taken: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, room = Path.write_bytes, iter(range(taken))

    def write_while_there_is_room(path: Path, data: bytes) -> int:
        if next(room, None) is None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", write_while_there_is_room)
    with pytest.raises(RecordingError, match=r"cannot write .*r: No space left"), writer_of(tmp_path / "r") as writer:
        for capture in FRAMES[:2]:
            writer.append(capture)
    assert not list(tmp_path.iterdir())


def test_a_damaged_or_missing_image_spoils_its_own_frame_alone(whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / "invalid_reason/000001.png").unlink()
        (folder / "depth_true/000002.tiff").write_bytes(b"")
        recording = Recording.open(folder)
        assert same(recording[0], FRAMES[0])
        with pytest.raises(RecordingError, match=r"invalid_reason/000001\.png: No such file"):
            recording[1]
        with pytest.raises(RecordingError, match=r"depth_true/000002\.tiff is damaged"):
            recording[2]
        assert same(recording[3], FRAMES[3])


@pytest.mark.parametrize(
    ("name", "data", "reported"),
    [
        ("frames.csv", None, "is not a recording"),
        ("config.toml", None, r"config\.toml: No such file"),
        ("calibration.toml", None, r"calibration\.toml: No such file"),
        ("calibration.toml", b"fx_px = ", r"calibration\.toml is damaged"),
        ("calibration.toml", b"fx_px = 1.0", r"calibration\.toml is damaged"),
        ("frames.csv", b"", r"frames\.csv is damaged"),
        ("frames.csv", b"time\n", r"frames\.csv is damaged"),
        ("frames.csv", HEADER + b"0.0,1.0\n", r"frames\.csv is damaged"),
        ("frames.csv", HEADER + b"noon" + 12 * b",0.0" + b"\n", r"frames\.csv is damaged"),
    ],
)
def test_a_description_or_table_that_is_missing_or_damaged_is_named(
    name: str, data: bytes | None, reported: str, whole: Path
) -> None:
    with copy_of(whole) as folder:
        (folder / name).unlink()
        if data is not None:
            (folder / name).write_bytes(data)
        with pytest.raises(RecordingError, match=reported):
            Recording.open(folder)


def test_the_digest_covers_the_frames_that_are_requested(whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / LIST).unlink()
        assert Recording.open(folder).digest(N) == Recording.open(whole).digest(N)
        (folder / "occluded/000002.png").write_bytes(b"other")
        assert Recording.open(folder).digest(2) == Recording.open(whole).digest(2)
        assert Recording.open(folder).digest(3) != Recording.open(whole).digest(3)
        rows = (folder / "frames.csv").read_bytes().splitlines(keepends=True)
        (folder / "frames.csv").write_bytes(b"".join(rows[:-1]))
        assert Recording.open(folder).digest(2) == Recording.open(whole).digest(2), "nor the rows of later frames"


def test_the_digest_covers_the_poses(whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / LIST).unlink()
        table = (folder / "frames.csv").read_text().splitlines()
        table[1] = ",".join([*table[1].split(",")[:-1], "7.0"])
        (folder / "frames.csv").write_text("\n".join(table) + "\n")
        assert Recording.open(folder).digest(1) != Recording.open(whole).digest(1)
