"""Correcting into a folder: what is written, that it is whole or absent, and what is refused."""

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from voxdepth.paper.epochs import EpochEnd, Phase, VoxDepthDiagnostics
from voxdepth.paper.registration import Registration, RegistrationStatus
from voxdepth.plugins import fault_of
from voxdepth.ros import confidence_levels
from voxdepth.tools.correction import Correction
from voxdepth.tools.errors import ToolError
from voxdepth.tools.point_cloud import VERTEX, ply
from voxdepth.types import CorrectedDepth, Frame, Intrinsics, Source
from voxdepth.units import to_millimetres

CAMERA = Intrinsics.from_hfov(width_px=24, height_px=16, hfov_deg=80)
N_FRAMES = 7


class Frames:
    """A dataset in memory."""

    format, intrinsics = "tum", CAMERA

    def __init__(self, n_frames: int = N_FRAMES) -> None:
        rng = np.random.default_rng(0)
        self._depth_m = rng.uniform(0.5, 80, (n_frames, *CAMERA.shape)).astype(np.float32)
        self._depth_m[rng.random(self._depth_m.shape) < 0.3] = 0
        self._gray = rng.integers(0, 255, self._depth_m.shape, np.uint8)

    def __len__(self) -> int:
        return len(self._depth_m)

    def name(self, index: int) -> str:
        return f"{index:06d}"

    def __getitem__(self, index: int) -> Frame:
        return Frame(stamp_s=index / 30, gray=self._gray[index], depth_m=self._depth_m[index])


class Remembering:
    """Fills holes by what it saw last in the pixel, so that a lost memory shows in every later frame."""

    uses_gray = False

    def __init__(self) -> None:
        self.aligned = 0
        self.reset()

    def reset(self) -> None:
        self._seen_m = np.zeros(CAMERA.shape, np.float32)

    def align(self, frame: Frame) -> tuple[int, np.ndarray, np.ndarray]:
        self._seen_m = np.where(frame.depth_m > 0, frame.depth_m, self._seen_m)
        self.aligned += 1
        return self.aligned - 1, frame.depth_m, self._seen_m

    def combine(self, aligned: tuple[int, np.ndarray, np.ndarray]) -> CorrectedDepth:
        index, raw_m, depth_m = aligned
        status = RegistrationStatus.OK if index else RegistrationStatus.NOT_TRIED
        return CorrectedDepth(
            depth_m=depth_m,
            source=np.where(raw_m > 0, 1, 2 * (depth_m > 0)).astype(np.uint8),
            confidence=np.where(raw_m > 0, 1, 0.5 * (depth_m > 0)).astype(np.float32),
            timings_s={"warp": 0.001 * (index + 1)},
            diagnostics=VoxDepthDiagnostics(
                phase=Phase.CORRECTING if index else Phase.PASSTHROUGH,
                new_epoch=index == 0,
                registration=Registration(status=status, n_matches=index),
                epoch_end=EpochEnd.FEW_MATCHES if index == 3 else EpochEnd.NONE,
            ),
        )

    def process(self, frame: Frame) -> CorrectedDepth:
        return self.combine(self.align(frame))


def whole_corrector(**changes: Any) -> SimpleNamespace:
    """The same without halves, perhaps with changes of what it gives."""
    inner = Remembering()
    return SimpleNamespace(
        process=lambda frame: replace(inner.process(frame), **changes), reset=inner.reset, uses_gray=False
    )


def planned(dataset: Frames | None = None, make: Callable[[], Any] = Remembering, frames: int = N_FRAMES) -> Correction:
    """A correction of the first frames of a dataset."""
    made_from = {
        "corrector": "remembering",
        "folder": "walk",
        "format": "tum",
        "intrinsics": {"fx_px": 14.5, "width_px": 24},
        "versions": {"numpy": "2"},
        "config": {"window_frames": 10, "odometry": {"max_step_m": 0.5}},
    }
    return Correction(made_from=made_from, dataset=dataset or Frames(), frames=frames, corrector=make())


def ignore(done: int) -> None:
    """Progress that nobody watches."""


def contents(out: Path) -> dict[str, bytes]:
    """All files without what depends on the clock."""
    files = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    report = json.loads(files.pop("report.json"))
    report.pop("wall")
    return {**files, "report.json": json.dumps(report).encode()}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a correction. Read only."""
    out = tmp_path_factory.mktemp("whole") / "out"
    planned().run(out, None, ignore)
    return out


def test_every_frame_becomes_two_images_with_the_values_of_the_corrector(whole: Path) -> None:
    reference, dataset = Remembering(), Frames()
    for index in range(N_FRAMES):
        expected = reference.process(dataset[index])
        depth = cv2.imread(str(whole / "depth" / f"{index:06d}.png"), cv2.IMREAD_UNCHANGED)
        confidence = cv2.imread(str(whole / "confidence" / f"{index:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert depth.dtype == np.uint16
        assert confidence.dtype == np.uint8
        near = expected.depth_m < 65
        np.testing.assert_allclose(depth[near] / 1000, expected.depth_m[near], atol=0.00051)
        np.testing.assert_array_equal(depth[expected.depth_m > 65.536], 65535)
        np.testing.assert_allclose(confidence / 255, expected.confidence, atol=0.002)
    assert len(list((whole / "depth").iterdir())) == len(list((whole / "confidence").iterdir())) == N_FRAMES


def test_sources_are_images_and_clouds_have_every_pixel_with_a_depth(whole: Path, tmp_path: Path) -> None:
    replace(planned(frames=2), has_points=True).run(tmp_path / "out", None, ignore)
    assert not (whole / "points").exists()
    reference, dataset = Remembering(), Frames()
    for index in range(2):
        frame = dataset[index]
        expected = reference.process(frame)
        source = cv2.imread(str(tmp_path / "out" / "source" / f"{index:06d}.png"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(source, expected.source)
        header, _, body = (tmp_path / "out" / "points" / f"{index:06d}.ply").read_bytes().partition(b"end_header\n")
        assert header.startswith(b"ply\nformat binary_little_endian 1.0\n") and b"property float confidence" in header
        points = np.frombuffer(body, VERTEX)
        assert f"element vertex {len(points)}\n".encode() in header
        row, col = np.nonzero(expected.depth_m)
        np.testing.assert_array_equal(points["z"], expected.depth_m[row, col])
        np.testing.assert_allclose(points["x"] * CAMERA.fx_px / points["z"] + CAMERA.cx_px, col, atol=1e-4)
        np.testing.assert_allclose(points["y"] * CAMERA.fy_px / points["z"] + CAMERA.cy_px, row, atol=1e-4)
        np.testing.assert_array_equal(points["green"], frame.gray[row, col])
        np.testing.assert_array_equal(points["source"], expected.source[row, col])


def test_a_cloud_of_a_frame_with_a_pose_is_in_the_world() -> None:
    T, frame = np.eye(4), Frames()[0]
    T[:3, :3], T[:3, 3] = [[0, 0, 1], [-1, 0, 0], [0, -1, 0]], [10, 20, 30]  # It looks along the x axis; z is up.
    here, there = (
        np.frombuffer(ply(CAMERA, each, Remembering().process(each)).partition(b"end_header\n")[2], VERTEX)
        for each in (frame, replace(frame, T_world_cam=T))
    )
    np.testing.assert_allclose(there["x"], here["z"] + 10, rtol=1e-5)
    np.testing.assert_allclose(there["z"], 30 - here["y"], rtol=1e-4, atol=1e-4)


def test_frames_of_which_none_has_a_depth_are_refused_and_some_are_counted(tmp_path: Path) -> None:
    dataset = Frames()
    dataset._depth_m[[1, 3]] = 0
    assert planned(dataset).run(tmp_path / "some", None, ignore)["frames_without_depth"] == 2
    dataset._depth_m[:] = 0
    with pytest.raises(ToolError, match=r"no pixel of 7 frames of walk has a depth, .*another folder or topic"):
        planned(dataset).run(tmp_path / "none", None, ignore)
    assert [path.name for path in tmp_path.iterdir()] == ["some"]


def test_the_report_counts_what_happened(whole: Path) -> None:
    report = json.loads((whole / "report.json").read_text())
    reference, dataset = Remembering(), Frames()
    made = [reference.process(dataset[index]) for index in range(N_FRAMES)]
    assert report["frames"] == N_FRAMES
    assert report["corrector"] == "remembering"
    assert report["config"]["odometry"] == {"max_step_m": 0.5}
    assert report["coverage"]["raw"] == pytest.approx(np.mean([dataset[i].depth_m > 0 for i in range(N_FRAMES)]))
    medians_m = [np.median(depth_m[depth_m > 0]) for depth_m in (dataset[i].depth_m for i in range(N_FRAMES))]
    assert report["raw_median_m"]["p50"] == pytest.approx(np.median(medians_m), rel=0.01)
    assert report["coverage"]["corrected"] == pytest.approx(np.mean([one.depth_m > 0 for one in made]))
    shares = report["pixel_shares"]
    assert list(shares) == ["invalid", "sensor", "memory", "inpainted"]
    assert sum(shares.values()) == pytest.approx(1)
    assert shares["memory"] == pytest.approx(np.mean([one.source == 2 for one in made]))
    assert report["facts"]["epoch_end"] == {"few_matches": 1, "none": 6}
    assert report["facts"]["phase"] == {"correcting": 6, "passthrough": 1}
    assert report["facts"]["registration"] == {"not_tried": 1, "ok": 6}
    assert report["facts"]["new_epoch"] == {"yes": 1, "no": 6}
    assert report["facts"]["n_matches"] == pytest.approx({"p50": 3, "p95": 5.7, "max": 6})
    assert report["wall"]["steps_s"]["warp"] == pytest.approx({"p50": 0.004, "p95": 0.0067, "max": 0.007})


def test_every_frame_has_a_line_with_the_facts_of_the_corrector(whole: Path) -> None:
    rows = list(csv.DictReader((whole / "frames.csv").read_text().splitlines()))
    assert [row["name"] for row in rows] == [f"{index:06d}" for index in range(N_FRAMES)]
    assert [row["phase"] for row in rows] == ["passthrough"] + ["correcting"] * 6
    assert [row["epoch_end"] for row in rows] == ["none"] * 3 + ["few_matches"] + ["none"] * 3
    assert [int(row["n_matches"]) for row in rows] == list(range(N_FRAMES))
    for row in rows:
        pixels = [int(row[f"{source}_pixels"]) for source in ("invalid", "sensor", "memory", "inpainted")]
        assert sum(pixels) == CAMERA.height_px * CAMERA.width_px
        assert int(row["raw_pixels"]) == pixels[1]


def test_a_corrector_without_stages_gives_the_same_files(whole: Path, tmp_path: Path) -> None:
    planned(make=whole_corrector).run(tmp_path / "out", None, ignore)
    assert contents(tmp_path / "out") == contents(whole)


def test_frames_without_depth_and_correctors_without_steps_count_in_no_median(tmp_path: Path) -> None:
    dataset = Frames(2)
    dataset._depth_m[0], dataset._depth_m[1] = 0, 3
    report = planned(dataset, lambda: whole_corrector(timings_s={}), 2).run(tmp_path / "out", None, ignore)
    assert report["raw_median_m"]["p50"] == pytest.approx(3, rel=0.01)
    assert report["wall"]["steps_s"] == {} and "frame_s" not in report["wall"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_a_correction_that_stops_leaves_nothing_behind(error: BaseException, whole: Path, tmp_path: Path) -> None:
    def stop(done: int) -> None:
        if done == 4:
            raise error

    with pytest.raises((KeyboardInterrupt, ToolError)):
        planned().run(tmp_path / "new" / "out", None, stop)
    assert not list((tmp_path / "new").iterdir())
    planned().run(tmp_path / "out", None, ignore)
    assert contents(tmp_path / "out") == contents(whole)


@pytest.mark.filterwarnings("ignore:frame 1 is left out")
def test_frames_of_one_time_are_refused_since_all_that_follow_would_have_wrong_names(tmp_path: Path) -> None:
    class Twice(Frames):
        def __getitem__(self, index: int) -> Frame:
            return replace(super().__getitem__(index), stamp_s=max(index, 1) / 30)

    with pytest.raises(ToolError, match=f"1 of {N_FRAMES} frames of walk are not later than the one before"):
        planned(Twice()).run(tmp_path / "out", None, ignore)
    assert not list(tmp_path.iterdir())


def test_a_bug_in_a_corrector_shows_its_place(tmp_path: Path) -> None:
    class Wrong(Remembering):
        def combine(self, aligned: object) -> CorrectedDepth:
            raise KeyError("template")

    with pytest.raises(KeyError, match="template") as caught:
        planned(make=Wrong).run(tmp_path / "out", None, ignore)
    assert caught.traceback[-1].name == "combine"


def test_an_empty_folder_is_taken_and_progress_counts_every_frame(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    reported: list[int] = []
    planned().run(tmp_path, None, reported.append)
    assert contents(tmp_path) == contents(whole)
    assert reported == list(range(1, N_FRAMES + 1))
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    with pytest.raises(ToolError, match="cannot be replaced as a whole"):
        planned().run(Path("../here"), None, ignore)


def test_of_two_writers_of_one_folder_the_later_one_fails(tmp_path: Path) -> None:
    def meanwhile(done: int) -> None:
        if done == 2:
            planned().run(tmp_path / "out", None, ignore)

    with pytest.raises(ToolError, match="has files by now, which nothing replaces: name another folder"):
        planned(frames=3).run(tmp_path / "out", None, meanwhile)
    assert len(list((tmp_path / "out" / "depth").iterdir())) == N_FRAMES


@pytest.mark.parametrize(
    ("out", "record", "message"),
    [
        (".", None, "exists already"),
        ("mine.txt", None, "exists already"),
        ("mine.txt/out", None, r"cannot write .*mine\.txt/out"),
        ("out", "mine.txt/out.rrd", r"cannot write .*mine\.txt/out\.rrd"),
    ],
)
def test_what_exists_is_not_touched_and_what_cannot_be_written_is_named_and_nothing_is_left(
    out: str, record: str | None, message: str, tmp_path: Path
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ToolError, match=message):
        planned().run(tmp_path / out, None if record is None else tmp_path / record, ignore)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_depth_is_stored_in_millimetres_and_stays_valid_or_invalid_and_confidence_from_none_to_full() -> None:
    depth_m = np.array([[0, 1e-5, 0.0004, 1.2344, 1.2346, 65.535, 65.6, 3e38]], np.float32)
    stored = to_millimetres(depth_m)
    assert stored.dtype == np.uint16
    assert stored.tolist() == [[0, 1, 1, 1234, 1235, 65535, 65535, 65535]]
    assert confidence_levels(np.array([[0, 0.5, 0.999, 1]], np.float32)).tolist() == [[0, 128, 255, 255]]


@pytest.mark.parametrize(
    ("spoil", "reported"),
    [
        (lambda result: result.depth_m, "a CorrectedDepth, got ndarray"),
        (lambda result: replace(result, depth_m=result.depth_m[::2]), "depth_m as float32 of shape (16, 24)"),
        (lambda result: replace(result, depth_m=result.depth_m.astype(np.float64)), "got float64 of shape (16, 24)"),
        (lambda result: replace(result, confidence=None), "confidence as floats of shape (16, 24), got NoneType"),
        (lambda result: replace(result, confidence=np.nan * result.confidence), "confidence in 0..1, got nan"),
        (lambda result: replace(result, source=Source.SENSOR), "source as uint8 of shape (16, 24), got Source"),
        (lambda result: replace(result, depth_m=result.depth_m - 1), "depths of at least 0 m (0 = invalid), got -1.0"),
        (lambda result: replace(result, depth_m=np.float32(np.nan) * result.depth_m), "finite depths (0 = invalid)"),
        (lambda result: replace(result, confidence=result.confidence * np.float32(1.2)), "confidence in 0..1, got"),
        (lambda result: replace(result, source=result.source + np.uint8(7)), "sources in 0..3, got"),
    ],
)
def test_what_no_corrector_may_return_is_reported(spoil: Callable[[CorrectedDepth], Any], reported: str) -> None:
    result = Remembering().process(Frames()[0])
    assert fault_of(result, CAMERA.shape) is None
    fault = fault_of(spoil(result), CAMERA.shape)
    assert reported in fault
    assert fault.startswith("expected ")
