"""Laws of recordings on disk: what was written reads back, and nothing that happens to the writer changes that."""

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

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim import frames
from sim.errors import RecordingError
from sim.recording import Recording, RecordingWriter, files
from sim.types import Capture
from voxdepth.types import FloatArray, Intrinsics

SMALL = Intrinsics(
    fx_px=1 / 3, fy_px=0.1 + 0.2, cx_px=np.pi / 10, cy_px=1e-17, width_px=9, height_px=7, baseline_m=0.0949999999999999
)
CONFIG = "seed = 3\r\n# Straße\n"
N = 4
FOLDERS = ("gray_left", "gray_right", "depth_raw", "depth_true", "occluded", "segment", "invalid_reason")
TEXTS = ("checksums.txt", "groundtruth.txt")


def any_capture(seed: int, stamp_s: float, intrinsics: Intrinsics = SMALL) -> tuple[Capture, FloatArray]:
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
    capture = Capture(
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
    return capture, q


FRAMES = [any_capture(k, k / 30) for k in range(N)]


def create(folder: Path) -> RecordingWriter:
    return RecordingWriter.create(folder, intrinsics=SMALL, config_text=CONFIG)


def resume(folder: Path) -> RecordingWriter:
    return RecordingWriter.resume(folder, intrinsics=SMALL, config_text=CONFIG)


def finish(writer: RecordingWriter) -> None:
    for capture, q in FRAMES[writer.frames :]:
        writer.append(capture, q)


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def same(a: Capture, b: Capture) -> bool:
    """Equal to the last bit, types included."""

    def bits(value: object) -> object:
        return (value.dtype, value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value

    return all(bits(getattr(a, field.name)) == bits(getattr(b, field.name)) for field in fields(Capture))


def reads_back(folder: Path, n_frames: int) -> bool:
    recording = Recording.open(folder)
    recording.verify()
    return len(recording) == n_frames and all(same(a, b) for a, (b, _) in zip(recording, FRAMES, strict=False))


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of all frames, written in one go."""
    folder = tmp_path_factory.mktemp("whole")
    with create(folder) as writer:
        finish(writer)
    return folder


@pytest.fixture(scope="module")
def commits(tmp_path_factory: pytest.TempPathFactory) -> list[tuple[int, ...]]:
    """Sizes of the text files once so many frames are whole."""
    folder = tmp_path_factory.mktemp("commits")
    writer = create(folder)
    sizes = [(0, 0)]
    for capture, q in FRAMES:
        writer.append(capture, q)
        sizes.append(tuple((folder / name).stat().st_size for name in TEXTS))
    return sizes


@contextmanager
def copy_of(folder: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as temporary:
        yield shutil.copytree(folder, Path(temporary) / "recording")


@given(st.integers(0, 2**32), st.integers(1, 12), st.integers(1, 12), st.floats(allow_nan=False, allow_infinity=False))
def test_what_was_written_reads_back_to_the_last_bit(seed: int, width: int, height: int, stamp_s: float) -> None:
    intrinsics = replace(SMALL, width_px=width, height_px=height)
    capture, q = any_capture(seed, stamp_s, intrinsics)
    with tempfile.TemporaryDirectory() as folder:
        RecordingWriter.create(Path(folder), intrinsics=intrinsics, config_text=CONFIG).append(capture, q)
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
    lengths = {name: draw(st.floats(1e-300, 1e300)) for name in ("fx_px", "fy_px", "baseline_m")}
    centre = {
        name: draw(st.floats(-0.5, 1.5)) * sizes[side] for name, side in (("cx_px", "width_px"), ("cy_px", "height_px"))
    }
    return Intrinsics(**sizes, **lengths, **centre)


@given(any_intrinsics())
def test_intrinsics_read_back_equal(intrinsics: Intrinsics) -> None:
    with tempfile.TemporaryDirectory() as folder:
        RecordingWriter.create(Path(folder), intrinsics=intrinsics, config_text="")
        assert Recording.open(Path(folder)).intrinsics == intrinsics


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="sha256sum is not installed")
def test_sha256sum_accepts_the_checksums(whole: Path) -> None:
    command = ["sha256sum", "--check", "--strict", "checksums.txt"]
    done = subprocess.run(command, cwd=whole, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(": OK") == 2 + N * len(FOLDERS)


def test_the_ground_truth_is_in_the_tum_format(whole: Path) -> None:
    rows = np.loadtxt(whole / "groundtruth.txt")
    for row, (capture, q) in zip(rows, FRAMES, strict=True):
        np.testing.assert_array_equal(row, [capture.stamp_s, *capture.T_world_cam[:3, 3], *q])


def test_frames_encoded_in_threads_give_the_same_files(tmp_path: Path, whole: Path) -> None:
    with create(tmp_path / "threads") as writer, ThreadPoolExecutor(N) as pool:
        jobs = [pool.submit(writer.encode, index, *FRAMES[index]) for index in range(N)]
        for job in jobs:
            writer.commit(job.result())
    assert contents(tmp_path / "threads") == contents(whole)


def test_frames_are_committed_in_order(tmp_path: Path) -> None:
    writer = create(tmp_path)
    second = writer.encode(1, *FRAMES[1])
    with pytest.raises(RecordingError, match="expected frame 0 to be committed next, got frame 1"):
        writer.commit(second)
    writer.append(*FRAMES[0])
    with pytest.raises(RecordingError, match="frame 0 is already recorded"):
        writer.encode(0, *FRAMES[0])
    writer.commit(second)
    with pytest.raises(RecordingError, match=r"expected a frame later than 0\.03"):
        writer.append(*FRAMES[0])
    writer.close()
    with pytest.raises(RecordingError, match="the writer is closed"):
        writer.append(*FRAMES[2])
    assert reads_back(tmp_path, 2)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gray_right": None}, "got one without gray_right"),
        ({"depth_raw_m": np.zeros((7, 9))}, "depth_raw_m must be float32"),
        ({"occluded": np.zeros((9, 7), np.bool_)}, r"occluded must be bool.* of shape \(7, 9\)"),
        ({"segment_id": np.full((7, 9), -2, np.int32)}, "got ids from -2 to -2"),
        ({"segment_id": np.full((7, 9), 2**16 - 1, np.int32)}, r"segment_id must lie in -1\.\.65534"),
        ({"intrinsics": replace(SMALL, cx_px=3.0)}, "expected captures with"),
        ({"stamp_s": np.nan}, "expected a finite time"),
        ({"T_world_cam": np.nextafter(FRAMES[0][0].T_world_cam, np.inf)}, "to the last bit"),
        ({"T_world_cam": np.eye(3)}, r"expected a pose of shape \(4, 4\)"),
    ],
)
def test_captures_that_would_not_read_back_are_refused(
    changes: dict[str, object], message: str, tmp_path: Path
) -> None:
    writer = create(tmp_path)
    with pytest.raises(RecordingError, match=message):
        writer.append(replace(FRAMES[0][0], **changes), FRAMES[0][1])
    assert sorted(contents(tmp_path)) == ["calibration.toml", "checksums.txt", "config.toml", "groundtruth.txt"]
    finish(writer)
    assert reads_back(tmp_path, N)


def test_a_quaternion_of_another_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="unit quaternion"):
        create(tmp_path).append(FRAMES[0][0], 2 * FRAMES[0][1])


def test_a_camera_without_a_baseline_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="baseline_m"):
        RecordingWriter.create(tmp_path / "new", intrinsics=replace(SMALL, baseline_m=None), config_text="")
    assert not (tmp_path / "new").exists()


def test_nothing_is_overwritten(tmp_path: Path, whole: Path) -> None:
    before = contents(whole)
    with pytest.raises(RecordingError, match="not empty"):
        create(whole)
    assert contents(whole) == before
    (tmp_path / "file").write_text("mine")
    with pytest.raises(RecordingError, match="file: Not a directory"):
        create(tmp_path / "file")


@pytest.mark.parametrize("name", ["", "missing"])
@pytest.mark.parametrize("action", [Recording.open, resume])
def test_a_folder_that_is_no_recording_is_refused(tmp_path: Path, name: str, action: Callable[[Path], object]) -> None:
    with pytest.raises(RecordingError, match="is not a recording"):
        action(tmp_path / name)


def test_a_recording_made_differently_is_not_resumed(whole: Path) -> None:
    before = contents(whole)
    with pytest.raises(RecordingError, match=r"line 1 of its config.toml reads 'seed = 3\\r', not 'seed = 4'"):
        RecordingWriter.resume(whole, intrinsics=SMALL, config_text="seed = 4")
    with pytest.raises(RecordingError, match=r"cannot go on with Intrinsics\(fx_px=2\.0"):
        RecordingWriter.resume(whole, intrinsics=replace(SMALL, fx_px=2.0), config_text=CONFIG)
    assert contents(whole) == before


@given(data=st.data())
def test_a_cut_recording_is_resumed_after_its_last_whole_frame(
    data: st.DataObject, whole: Path, commits: list[tuple[int, ...]]
) -> None:
    full = contents(whole)
    with copy_of(whole) as folder:
        kept = [data.draw(st.integers(0, len(full[name])) | st.just(len(full[name]))) for name in TEXTS]
        for name, size in zip(TEXTS, kept, strict=True):
            os.truncate(folder / name, size)
        written = max(n for n, sizes in enumerate(commits) if all(s <= k for s, k in zip(sizes, kept, strict=True)))
        assert reads_back(folder, written)
        images = sorted(set(full) - {*TEXTS, "calibration.toml", "config.toml"})
        lost = data.draw(st.sets(st.sampled_from(images), max_size=2))
        for name in lost:
            (folder / name).unlink()
        for name in data.draw(st.sets(st.sampled_from([*images, *TEXTS]), max_size=3)):
            (folder / f"{name}.tmp").write_bytes(full[name][:20])
        (folder / "invalid_reason" / "000017.png").write_bytes(b"of a later frame")
        writer = resume(folder)
        assert writer.frames == min([written, *(int(Path(name).stem) for name in lost)])
        assert reads_back(folder, writer.frames)
        finish(writer)
        assert contents(folder) == full


@given(data=st.data())
def test_no_flipped_bit_goes_unseen(data: st.DataObject, whole: Path) -> None:
    full = contents(whole)
    name = data.draw(st.sampled_from(sorted(full)))
    at = data.draw(st.integers(0, len(full[name]) - 2))
    with copy_of(whole) as folder:
        damaged = bytearray(full[name])
        damaged[at] ^= 1 << data.draw(st.integers(0, 7))
        (folder / name).write_bytes(damaged)
        with pytest.raises(RecordingError, match=r"damaged|config\.toml") as caught:
            Recording.open(folder).verify()
        if name != "checksums.txt":
            assert name in str(caught.value)


def test_a_damaged_or_missing_image_spoils_its_own_frame_alone(whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / "invalid_reason/000001.png").unlink()
        (folder / "depth_true/000002.tiff").write_bytes(b"")
        recording = Recording.open(folder)
        assert same(recording[0], FRAMES[0][0])
        with pytest.raises(RecordingError, match=r"invalid_reason/000001\.png: No such file"):
            recording[1]
        with pytest.raises(RecordingError, match=r"depth_true/000002\.tiff is damaged"):
            recording[2]
        assert same(recording[3], FRAMES[3][0])
        with pytest.raises(RecordingError, match=r"invalid_reason/000001\.png"):
            recording.verify()


@pytest.mark.parametrize("name", TEXTS)
def test_a_missing_text_file_is_named(name: str, whole: Path) -> None:
    with copy_of(whole) as folder:
        (folder / name).unlink()
        with pytest.raises(RecordingError, match=f"{name}: No such file"):
            resume(folder)


@pytest.mark.parametrize("taken", range(2 * (len(FOLDERS) + 2)))
def test_a_full_disk_costs_no_whole_frame(
    taken: int, tmp_path: Path, whole: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = create(tmp_path)
    writer.append(*FRAMES[0])
    write, room = files.write, iter(range(taken))

    def write_while_there_is_room(path: Path, data: bytes, mode: str) -> None:
        fits = next(room, None) is not None
        write(path, data if fits else data[: len(data) // 2], mode)
        if not fits:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(files, "write", write_while_there_is_room)
        with pytest.raises(RecordingError, match=r"(png|tiff|txt): No space left on device; [12] whole frames"):
            finish(writer)
    n_whole = 1 + taken // (len(FOLDERS) + 2)
    assert writer.frames == n_whole
    assert reads_back(tmp_path, n_whole)
    writer.close()
    resumed = resume(tmp_path)
    assert resumed.frames == n_whole
    finish(resumed)
    assert contents(tmp_path) == contents(whole)


def test_after_a_failed_commit_nothing_is_appended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = create(tmp_path)
    encoded = writer.encode(0, *FRAMES[0])
    (tmp_path / "checksums.txt").unlink()
    (tmp_path / "checksums.txt").mkdir()
    with pytest.raises(RecordingError, match=r"checksums\.txt: Is a directory; 0 whole frames are safe"):
        writer.commit(encoded)
    with pytest.raises(RecordingError, match="frame 0 could not be committed; resume it with a new writer"):
        writer.commit(encoded)


def test_a_killed_process_leaves_whole_frames(tmp_path: Path) -> None:
    code = (
        "import sys; from pathlib import Path; from tests.unit.test_recording_format import *\n"
        "writer = create(Path(sys.argv[1]))\n"
        "while True: writer.append(*any_capture(writer.frames, writer.frames / 30))"
    )
    folder = tmp_path / "killed"
    with subprocess.Popen([sys.executable, "-c", code, folder], cwd=Path(__file__).parents[2]) as process:
        while not (folder / "invalid_reason" / "000020.png").exists() and process.poll() is None:
            time.sleep(0.001)
        process.send_signal(signal.SIGKILL)
    n_frames = len(Recording.open(folder))
    assert n_frames >= 19
    writer = resume(folder)
    assert writer.frames == n_frames
    writer.append(*any_capture(n_frames, n_frames / 30))
    recording = Recording.open(folder)
    recording.verify()
    assert len(recording) == n_frames + 1
    assert all(same(recording[k], any_capture(k, k / 30)[0]) for k in range(n_frames + 1))
