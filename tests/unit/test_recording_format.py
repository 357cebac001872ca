"""Laws of recordings on disk: what was written reads back, and an interrupted recording can be continued."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.errors import RecordingError
from sim.recording import Recording, RecordingWriter
from sim.types import Capture
from voxdepth.types import Intrinsics

SMALL = Intrinsics(
    fx_px=1 / 3, fy_px=0.1 + 0.2, cx_px=np.pi / 10, cy_px=1e-17, width_px=9, height_px=7, baseline_m=0.0949999999999999
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


def finish(writer: RecordingWriter) -> None:
    for capture in FRAMES[writer.frames :]:
        writer.append(capture)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def same(a: Capture, b: Capture) -> bool:
    """Equal to the last bit, types included."""

    def bits(value: object) -> object:
        return (value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value

    return all(bits(getattr(a, field.name)) == bits(getattr(b, field.name)) for field in fields(Capture))


def reads_back(folder: Path, n_frames: int) -> bool:
    recording = Recording.open(folder)
    return len(recording) == n_frames and all(same(a, b) for a, b in zip(recording, FRAMES, strict=False))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of all frames, written without interruption."""
    folder = tmp_path_factory.mktemp("whole")
    with writer_of(folder) as writer:
        finish(writer)
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


@st.composite
def any_intrinsics(draw: st.DrawFn) -> Intrinsics:
    sizes = {name: draw(st.integers(1, 2**16)) for name in ("width_px", "height_px")}
    lengths = {name: draw(st.floats(1e-3, 1e3)) for name in ("fx_px", "fy_px")}
    lengths["baseline_m"] = draw(st.floats(1e-3, 10))
    centre = {
        name: draw(st.floats(-0.5, 1.5)) * sizes[side] for name, side in (("cx_px", "width_px"), ("cy_px", "height_px"))
    }
    return Intrinsics(**sizes, **lengths, **centre)


@given(any_intrinsics())
def test_intrinsics_read_back_equal(intrinsics: Intrinsics) -> None:
    with tempfile.TemporaryDirectory() as folder:
        RecordingWriter(Path(folder), intrinsics=intrinsics, config_text="").close()
        assert Recording.open(Path(folder)).intrinsics == intrinsics


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


def test_rows_follow_images_and_time(tmp_path: Path) -> None:
    writer = writer_of(tmp_path)
    writer.write_images(1, FRAMES[1])
    with pytest.raises(RecordingError, match=r"images of frame 0 .*000000"):
        writer.append_row(FRAMES[0])
    writer.append(FRAMES[0])
    with pytest.raises(RecordingError, match="frame 0 is already recorded"):
        writer.write_images(0, FRAMES[0])
    writer.append_row(FRAMES[1])
    with pytest.raises(RecordingError, match=r"later than 0\.03"):
        writer.append(FRAMES[0])
    writer.close()
    with pytest.raises(RecordingError, match="closed"):
        writer.append(FRAMES[2])
    assert reads_back(tmp_path, 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gray_right": None}, "gray_right must be uint8"),
        ({"depth_raw_m": np.zeros((7, 9))}, "depth_raw_m must be float32"),
        ({"occluded": np.zeros((9, 7), np.bool_)}, r"occluded must be bool.* of shape \(7, 9\)"),
        ({"segment_id": np.full((7, 9), -2, np.int32)}, "got ids from -2 to -2"),
        ({"segment_id": np.full((7, 9), 2**16 - 1, np.int32)}, r"-1\.\.65534"),
        ({"intrinsics": replace(SMALL, cx_px=3.0)}, "cx_px=3"),
        ({"stamp_s": np.nan}, "nan s"),
        ({"T_world_cam": np.full((4, 4), np.inf)}, "finite"),
        ({"T_world_cam": np.eye(4, dtype=np.float32)}, "float64"),
        ({"T_world_cam": np.eye(3)}, r"\(4, 4\)"),
    ],
)
def test_captures_that_would_not_read_back_are_refused(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with writer_of(tmp_path) as writer:
        with pytest.raises(RecordingError, match=message):
            writer.append(replace(FRAMES[0], **changes))
        assert sorted(contents(tmp_path)) == ["calibration.toml", "config.toml", "frames.csv"]
        finish(writer)
    assert reads_back(tmp_path, N)


def test_a_camera_without_a_baseline_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="baseline_m"):
        RecordingWriter(tmp_path / "new", intrinsics=replace(SMALL, baseline_m=None), config_text="")
    assert not (tmp_path / "new").exists()


def test_foreign_files_are_not_touched(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(RecordingError, match="not empty"):
        writer_of(tmp_path)
    with pytest.raises(RecordingError, match=r"thesis\.txt"):
        writer_of(tmp_path / "thesis.txt")
    assert contents(tmp_path) == {"thesis.txt": b"mine"}


@pytest.mark.parametrize("name", ["", "missing"])
def test_a_folder_that_is_no_recording_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(RecordingError, match="is not a recording"):
        Recording.open(tmp_path / name)


def test_a_recording_made_differently_is_not_continued(whole: Path) -> None:
    before = contents(whole)
    with pytest.raises(RecordingError, match=r"line 1 of its config.toml is 'seed = 3\\r', not 'seed = 4'"):
        RecordingWriter(whole, intrinsics=SMALL, config_text="seed = 4")
    with pytest.raises(RecordingError, match=r"calibration.toml is .*, not 'fx_px = 2\.0'"):
        RecordingWriter(whole, intrinsics=replace(SMALL, fx_px=2.0), config_text=CONFIG)
    assert contents(whole) == before


@pytest.mark.parametrize("lost", range(N))
def test_a_recording_continues_before_the_first_frame_whose_image_is_lost(lost: int, whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / "invalid_reason" / f"{lost:06d}.png").unlink()
        with writer_of(folder) as writer:
            assert writer.frames == lost
            finish(writer)
        assert contents(folder) == contents(whole)


@given(data=st.data())
def test_an_interrupted_recording_that_is_continued_equals_an_undisturbed_one(data: st.DataObject, whole: Path) -> None:
    """The interruption cuts the table anywhere and leaves images of later frames, complete or not."""
    full = contents(whole)
    table = full["frames.csv"]
    with copy_of(whole) as folder:
        kept = data.draw(st.integers(0, len(table)))
        os.truncate(folder / "frames.csv", kept)
        n_whole = max(0, table[:kept].count(b"\n") - 1)
        later = [name for name in full if "/" in name and int(Path(name).stem) >= n_whole]
        for name in data.draw(st.sets(st.sampled_from(later))) if later else ():
            (folder / name).write_bytes(full[name][: data.draw(st.integers(0, 20))])
        for name in data.draw(st.sets(st.sampled_from(later))) if later else ():
            (folder / name).unlink()
        (folder / "invalid_reason" / "000017.png").write_bytes(b"of a later frame")
        assert reads_back(folder, n_whole)
        with writer_of(folder) as writer:
            assert writer.frames == n_whole
            assert reads_back(folder, n_whole)
            finish(writer)
        assert contents(folder) == full


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


@pytest.mark.parametrize("action", [Recording.open, writer_of])
@pytest.mark.parametrize("name", ["config.toml", "calibration.toml"])
def test_a_missing_description_is_named(name: str, action: Callable[[Path], object], whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / name).unlink()
        with pytest.raises(RecordingError, match=f"{name}: No such file"):
            action(folder)


@pytest.mark.parametrize("table", [b"time\n", HEADER + b"0.0,1.0\n", HEADER + b"noon" + 12 * b",0.0" + b"\n"])
@pytest.mark.parametrize("action", [Recording.open, writer_of])
def test_a_damaged_table_is_refused(table: bytes, action: Callable[[Path], object], whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / "frames.csv").write_bytes(table)
        with pytest.raises(RecordingError, match=r"frames\.csv is damaged"):
            action(folder)


def test_the_digest_covers_the_frames_that_are_asked_for(whole: Path) -> None:
    with copy_of(whole) as folder:
        assert Recording.open(folder).digest(N) == Recording.open(whole).digest(N)
        (folder / "occluded/000002.png").write_bytes(b"other")
        assert Recording.open(folder).digest(2) == Recording.open(whole).digest(2)
        assert Recording.open(folder).digest(3) != Recording.open(whole).digest(3)


@pytest.mark.parametrize("taken", range(2 * len(FOLDERS)))
def test_a_full_disk_costs_no_complete_frame(
    taken: int, tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, room = Path.write_bytes, iter(range(taken))

    def write_while_there_is_room(path: Path, data: bytes) -> int:
        fits = next(room, None) is not None
        write(path, data if fits else data[: len(data) // 2])
        if not fits:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return len(data)

    n_whole = 1 + taken // len(FOLDERS)
    with writer_of(tmp_path) as writer, monkeypatch.context() as patch:
        writer.append(FRAMES[0])
        patch.setattr(Path, "write_bytes", write_while_there_is_room)
        with pytest.raises(RecordingError, match=rf"(png|tiff): No space left on device; {n_whole} complete frames"):
            finish(writer)
    assert reads_back(tmp_path, n_whole)
    with writer_of(tmp_path) as resumed:
        assert resumed.frames == n_whole
        finish(resumed)
    assert contents(tmp_path) == contents(whole)


def test_after_a_row_that_failed_nothing_is_appended(tmp_path: Path, whole: Path) -> None:
    class Full:
        """A file on a full disk."""

        closed = False

        def write(self, data: bytes) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def close(self) -> None:
            self.closed = True

    writer = writer_of(tmp_path)
    writer.append(FRAMES[0])
    writer._table.close()
    writer._table = Full()  # type: ignore[assignment]
    with pytest.raises(RecordingError, match=r"frames\.csv: No space left on device; 1 complete frames"):
        writer.append(FRAMES[1])
    with pytest.raises(RecordingError, match="closed"):
        writer.append(FRAMES[1])
    with writer_of(tmp_path) as resumed:
        finish(resumed)
    assert contents(tmp_path) == contents(whole)


@pytest.mark.parametrize("n_writes", range(2))
def test_a_disk_that_is_full_from_the_start_can_be_tried_again(
    tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch, n_writes: int
) -> None:
    write, room = Path.write_bytes, iter(range(n_writes))

    def full_after(path: Path, data: bytes) -> int:
        if next(room, None) is None:
            write(path, data[: len(data) // 2])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return write(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "write_bytes", full_after)
        with pytest.raises(RecordingError, match="No space left on device"):
            writer_of(tmp_path)
    with writer_of(tmp_path) as writer:
        finish(writer)
    assert contents(tmp_path) == contents(whole)


def test_two_writers_do_not_share_a_folder(tmp_path: Path) -> None:
    first = writer_of(tmp_path / "r")
    first.append(FRAMES[0])
    before = contents(tmp_path / "r")
    with pytest.raises(RecordingError, match="another writer"):
        writer_of(tmp_path / "r")
    assert contents(tmp_path / "r") == before
    first.close()
    with writer_of(tmp_path / "r") as second:
        assert second.frames == 1
        finish(second)
    assert reads_back(tmp_path / "r", N)


def test_a_killed_recording_that_is_continued_equals_an_undisturbed_one(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from tests.unit.test_recording_format import *\n"
        "writer = writer_of(Path(sys.argv[1]))\n"
        "while True: writer.append(any_capture(writer.frames, writer.frames / 30))"
    )
    killed, undisturbed = tmp_path / "killed", tmp_path / "undisturbed"
    with subprocess.Popen([sys.executable, "-c", code, killed], cwd=Path(__file__).parents[2]) as process:
        while not (killed / "invalid_reason" / "000020.png").exists() and process.poll() is None:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
    n_frames = len(Recording.open(killed))
    assert n_frames >= 19
    for folder in (killed, undisturbed):
        with writer_of(folder) as writer:
            for k in range(writer.frames, n_frames + 2):
                writer.append(any_capture(k, k / 30))
    assert contents(killed) == contents(undisturbed)
