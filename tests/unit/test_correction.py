"""Correcting into a folder: what is written, what a second run does, and what is refused."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from scenarios.corrected_folder import Correction
from scenarios.correction import Corrected, Job, correct
from scenarios.errors import ScenarioError
from voxdepth.errors import DatasetError
from voxdepth.types import CorrectedDepth, EpochEnd, Frame, Intrinsics, Phase, Registration, RegistrationStatus

CAMERA = Intrinsics.from_hfov(width_px=24, height_px=16, hfov_deg=80)
N_FRAMES = 7


class Frames:
    """A dataset in memory; the frames `broken` cannot be read."""

    def __init__(self, n_frames: int = N_FRAMES, *, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.format = "tum"
        self.intrinsics = CAMERA
        self.broken: set[int] = set()
        self._depth_m = rng.uniform(0.5, 80, (n_frames, *CAMERA.shape)).astype(np.float32)
        self._depth_m[rng.random(self._depth_m.shape) < 0.3] = 0
        self._gray = rng.integers(0, 255, self._depth_m.shape, np.uint8)

    def __len__(self) -> int:
        return len(self._depth_m)

    def name(self, index: int) -> str:
        return f"{index:06d}"

    def __getitem__(self, index: int) -> Frame:
        if index in self.broken:
            raise DatasetError(f"depth/{index}.png is cut short")
        return Frame(stamp_s=index / 30, gray=self._gray[index], depth_m=self._depth_m[index])


class Remembering:
    """Fills holes by what it saw last in the pixel, so that a lost memory shows in every later frame."""

    uses_gray = False

    def __init__(self) -> None:
        self.aligned, self.combined = 0, 0
        self.reset()

    def reset(self) -> None:
        self._seen_m = np.zeros(CAMERA.shape, np.float32)

    def align(self, frame: Frame) -> tuple[int, np.ndarray, np.ndarray]:
        self._seen_m = np.where(frame.depth_m > 0, frame.depth_m, self._seen_m)
        self.aligned += 1
        return self.aligned - 1, frame.depth_m, self._seen_m

    def combine(self, aligned: tuple[int, np.ndarray, np.ndarray]) -> CorrectedDepth:
        self.combined += 1
        index, raw_m, depth_m = aligned
        status = RegistrationStatus.OK if index else RegistrationStatus.NOT_TRIED
        return CorrectedDepth(
            depth_m=depth_m,
            source=np.where(raw_m > 0, 1, 2 * (depth_m > 0)).astype(np.uint8),
            confidence=np.where(raw_m > 0, 1, 0.5 * (depth_m > 0)).astype(np.float32),
            phase=Phase.CORRECTING if index else Phase.PASSTHROUGH,
            registration=Registration.identity(status, n_matches=index),
            epoch_end=EpochEnd.FEW_MATCHES if index == 3 else None,
            timings_s={"warp": 0.001 * (index + 1)},
        )

    def process(self, frame: Frame) -> CorrectedDepth:
        return self.combine(self.align(frame))


class Whole:
    """The same without halves."""

    uses_gray = False

    def __init__(self) -> None:
        self._inner = Remembering()

    def process(self, frame: Frame) -> CorrectedDepth:
        return self._inner.process(frame)

    def reset(self) -> None:
        self._inner.reset()


class Bench:
    """Runs corrections of one input, and keeps the correctors that were made."""

    def __init__(self, dataset: Frames | None = None, make: Callable[[], object] = Remembering) -> None:
        self.dataset = dataset or Frames()
        self.made: list = []
        self._make = make
        self.config: dict = {"window_frames": 10, "odometry": {"max_step_m": 0.5}}

    def job(self, frames: int = N_FRAMES, *, corrector: str = "remembering", folder: str = "walk") -> Job:
        correction = Correction(
            corrector=corrector,
            folder=folder,
            format="tum",
            intrinsics={"fx_px": 14.5, "width_px": 24},
            versions={"numpy": "2"},
            config=self.config,
        )
        return Job(correction=correction, dataset=self.dataset, frames=frames, corrector=self._create())

    def run(self, out: Path, frames: int = N_FRAMES, record: Path | None = None, **named: str) -> Corrected:
        return correct(self.job(frames, **named), out, record, lambda done: None)

    def _create(self) -> Any:
        self.made.append(self._make())
        return self.made[-1]


def contents(out: Path) -> dict[str, bytes]:
    """All files but for what depends on the clock."""
    files = {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("*")) if path.is_file()}
    lines = [json.loads(line) for line in files.pop("frames.jsonl").splitlines()]
    report = json.loads(files.pop("report.json")) if "report.json" in files else {}
    report.pop("wall", None)
    timeless = [{key: value for key, value in line.items() if key != "wall_s"} for line in lines]
    return {**files, "frames.jsonl": json.dumps(timeless).encode(), "report.json": json.dumps(report).encode()}


def stop_after(done: int, error: BaseException) -> Callable[[int], None]:
    def progress(frames: int) -> None:
        if frames == done:
            raise error

    return progress


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an uninterrupted run. Read only."""
    out = tmp_path_factory.mktemp("whole") / "out"
    Bench().run(out)
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


def test_the_report_counts_what_happened(whole: Path) -> None:
    report = json.loads((whole / "report.json").read_text())
    reference, dataset = Remembering(), Frames()
    made = [reference.process(dataset[index]) for index in range(N_FRAMES)]
    assert report["frames"] == N_FRAMES
    assert report["corrector"] == "remembering"
    assert report["config"]["odometry"] == {"max_step_m": 0.5}
    assert report["coverage"]["raw"] == pytest.approx(np.mean([dataset[i].depth_m > 0 for i in range(N_FRAMES)]))
    assert report["coverage"]["corrected"] == pytest.approx(np.mean([one.depth_m > 0 for one in made]))
    shares = report["pixel_shares"]
    assert list(shares) == ["invalid", "sensor", "template", "inpainted"]
    assert sum(shares.values()) == pytest.approx(1)
    assert shares["template"] == pytest.approx(np.mean([one.source == 2 for one in made]))
    assert report["epochs"] == {"switches": 1, "causes": {"few_matches": 1, "degenerate": 0, "max_frames": 0}}
    assert report["phases"] == {"passthrough": 1, "fusing": 0, "correcting": 6}
    assert report["registrations"] == {"not_tried": 1, "ok": 6, "few_matches": 0, "degenerate": 0}
    assert report["wall"]["steps_s"]["warp"] == pytest.approx({"p50": 0.004, "p95": 0.0067, "max": 0.007})


@pytest.mark.parametrize("make", [Remembering, Whole])
@pytest.mark.parametrize("done", [1, 4, N_FRAMES])
def test_a_run_that_was_interrupted_goes_on_to_the_same_bytes(
    done: int, make: Callable[[], object], whole: Path, tmp_path: Path
) -> None:
    bench = Bench(make=make)
    with pytest.raises(KeyboardInterrupt):
        correct(bench.job(), tmp_path / "out", None, stop_after(done, KeyboardInterrupt()))
    assert not (tmp_path / "out" / "report.json").exists()
    assert len((tmp_path / "out" / "frames.jsonl").read_text().splitlines()) == done
    assert bench.run(tmp_path / "out").new_frames == N_FRAMES - done
    assert contents(tmp_path / "out") == contents(whole)


def test_finished_frames_are_aligned_again_but_not_combined(tmp_path: Path) -> None:
    Bench().run(tmp_path / "out", frames=3)
    bench = Bench()
    bench.run(tmp_path / "out")
    (corrector,) = bench.made
    assert (corrector.aligned, corrector.combined) == (N_FRAMES, N_FRAMES - 3)


def test_more_frames_of_a_finished_run_give_what_all_at_once_give(whole: Path, tmp_path: Path) -> None:
    assert Bench().run(tmp_path / "out", frames=2).new_frames == 2
    assert Bench().run(tmp_path / "out").new_frames == N_FRAMES - 2
    assert contents(tmp_path / "out") == contents(whole)


def test_a_finished_run_is_left_as_it_is(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "out")
    bench = Bench()
    before = {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in (tmp_path / "out").rglob("*.*")}
    done = bench.run(tmp_path / "out")
    assert done.new_frames == 0
    assert done.report == json.loads((whole / "report.json").read_text())
    assert bench.made[0].aligned == 0
    assert {p: (p.read_bytes(), p.stat().st_mtime_ns) for p in (tmp_path / "out").rglob("*.*")} == before


def test_a_run_killed_while_it_was_extended_is_not_taken_for_finished(whole: Path, tmp_path: Path) -> None:
    Bench().run(tmp_path / "out", frames=2)
    with pytest.raises(KeyboardInterrupt):
        correct(Bench().job(), tmp_path / "out", None, stop_after(N_FRAMES, KeyboardInterrupt()))
    assert not (tmp_path / "out" / "report.json").exists()
    assert Bench().run(tmp_path / "out").new_frames == 0
    assert contents(tmp_path / "out") == contents(whole)


def test_a_recording_that_fails_leaves_a_finished_run_finished(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "out")
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ScenarioError, match="cannot write the recording"):
        correct(Bench().job(), tmp_path / "out", tmp_path / "file" / "out.rrd", lambda done: None)
    assert contents(tmp_path / "out") == contents(whole)


def damage_torn(out: Path) -> None:
    text = (out / "frames.jsonl").read_bytes()
    (out / "frames.jsonl").write_bytes(text[:-9])


def damage_zeroed(out: Path) -> None:
    lines = (out / "frames.jsonl").read_bytes().split(b"\n")
    lines[4] = b"\0" * len(lines[4])
    (out / "frames.jsonl").write_bytes(b"\n".join(lines))


def damage_image(out: Path) -> None:
    (out / "depth" / "000002.png").write_bytes(b"")


def damage_missing(out: Path) -> None:
    (out / "confidence" / "000005.png").unlink()


def damage_debris(out: Path) -> None:
    lines = (out / "frames.jsonl").read_bytes().split(b"\n")
    (out / "frames.jsonl").write_bytes(b"\n".join(lines[:3]) + b"\n")
    (out / "depth" / "000006.png.tmp").write_bytes(b"half")


@pytest.mark.parametrize(
    ("damage", "kept"),
    [(damage_torn, 6), (damage_zeroed, 4), (damage_image, 2), (damage_missing, 5), (damage_debris, 3)],
)
def test_frames_that_are_not_whole_are_made_again(
    damage: Callable[[Path], None], kept: int, whole: Path, tmp_path: Path
) -> None:
    shutil.copytree(whole, tmp_path / "out")
    damage(tmp_path / "out")
    assert Bench().run(tmp_path / "out").new_frames == N_FRAMES - kept
    assert contents(tmp_path / "out") == contents(whole)


def test_images_of_frames_that_were_never_finished_are_taken_away(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "out")
    damage_debris(tmp_path / "out")
    (tmp_path / "out" / "depth" / "mine.png").write_bytes(b"mine")
    Bench().run(tmp_path / "out", frames=3)
    names = {path.name for path in (tmp_path / "out" / "depth").iterdir()}
    assert names == {"000000.png", "000001.png", "000002.png", "mine.png"}


@pytest.mark.parametrize("frames", [2, 5])
def test_a_bad_frame_keeps_those_before_it_and_can_be_mended(frames: int, whole: Path, tmp_path: Path) -> None:
    bench = Bench()
    bench.dataset.broken = {frames}
    for _ in range(2):
        with pytest.raises(DatasetError, match=f"depth/{frames}.png is cut short"):
            bench.run(tmp_path / "out")
        assert len((tmp_path / "out" / "frames.jsonl").read_text().splitlines()) == frames
    bench.dataset.broken = set()
    bench.run(tmp_path / "out")
    assert contents(tmp_path / "out") == contents(whole)


def test_a_bug_in_a_corrector_shows_its_place(tmp_path: Path) -> None:
    class Wrong(Remembering):
        def combine(self, aligned: object) -> CorrectedDepth:
            raise KeyError("template")

    with pytest.raises(KeyError, match="template") as caught:
        Bench(make=Wrong).run(tmp_path / "out")
    assert caught.traceback[-1].name == "combine"


def test_another_corrector_config_or_input_is_refused_by_name(whole: Path, tmp_path: Path) -> None:
    shutil.copytree(whole, tmp_path / "out")
    before = contents(tmp_path / "out")
    with pytest.raises(ScenarioError, match="was begun with corrector 'remembering', not 'raw'"):
        Bench().run(tmp_path / "out", corrector="raw")
    with pytest.raises(ScenarioError, match="was begun with folder 'walk', not 'run'"):
        Bench().run(tmp_path / "out", folder="run")
    bench = Bench()
    bench.config["odometry"]["max_step_m"] = 0.25
    with pytest.raises(ScenarioError, match=r"was begun with config\.odometry\.max_step_m 0\.5, not 0\.25"):
        bench.run(tmp_path / "out")
    bench.config = {"window_frames": 10}
    with pytest.raises(ScenarioError, match=r"was begun with config\.odometry\.max_step_m 0\.5, not 'not set'"):
        bench.run(tmp_path / "out")
    assert contents(tmp_path / "out") == before


def test_an_input_whose_images_changed_is_refused(tmp_path: Path) -> None:
    Bench().run(tmp_path / "out", frames=3)
    with pytest.raises(ScenarioError, match="frame 000000 of the input is not what it was"):
        Bench(Frames(seed=1)).run(tmp_path / "out")
    with pytest.raises(ScenarioError, match="has a frame 000002 where the input has none"):
        Bench(Frames(2)).run(tmp_path / "out", frames=2)


@pytest.mark.parametrize("name", ["thesis.txt", "config.toml", "frames.jsonl"])
def test_a_folder_of_something_else_is_not_touched(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("seed = 3\n")
    with pytest.raises(ScenarioError, match="is not empty and holds no correction"):
        Bench().run(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "seed = 3\n"


def test_an_empty_folder_and_one_where_a_start_failed_are_taken(whole: Path, tmp_path: Path) -> None:
    (tmp_path / "config.toml.tmp").write_text("corr")
    Bench().run(tmp_path)
    assert contents(tmp_path) == contents(whole)


def test_a_folder_that_was_begun_with_something_else_and_has_no_frame_is_taken(whole: Path, tmp_path: Path) -> None:
    wrong = Bench(Frames())
    wrong.dataset.broken = {0}
    wrong.config = {"window_frames": 99}
    with pytest.raises(DatasetError):
        wrong.run(tmp_path)
    Bench().run(tmp_path)
    assert contents(tmp_path) == contents(whole)


def test_a_second_writer_is_refused_while_the_first_is_at_work(tmp_path: Path) -> None:
    refused: list[str] = []

    def meanwhile(done: int) -> None:
        with pytest.raises(ScenarioError) as caught:
            Bench().run(tmp_path / "out")
        refused.append(str(caught.value))

    correct(Bench().job(frames=1), tmp_path / "out", None, meanwhile)
    assert set(refused) == {f"another process is correcting into {tmp_path / 'out'}: wait until it ends"}
    assert Bench().run(tmp_path / "out").new_frames == N_FRAMES - 1


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(ScenarioError, match=r"cannot write .*file"):
        Bench().run(tmp_path / "file")
    with pytest.raises(ScenarioError, match=r"cannot write .*file/out"):
        Bench().run(tmp_path / "file" / "out")
    assert (tmp_path / "file").read_text() == "mine"


def test_a_full_disk_says_what_is_safe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    Bench().run(tmp_path / "out", frames=2)

    def full(path: Path, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("scenarios.corrected_folder.replace", full)
    with pytest.raises(ScenarioError, match=r"000002\.png: No space left on device; 2 finished frames are safe in"):
        Bench().run(tmp_path / "out")
    monkeypatch.undo()
    assert Bench().run(tmp_path / "out").new_frames == N_FRAMES - 2


def test_progress_counts_every_frame_in_order(tmp_path: Path) -> None:
    Bench().run(tmp_path / "out", frames=3)
    told: list[int] = []
    correct(Bench().job(), tmp_path / "out", None, told.append)
    assert told == [*range(1, N_FRAMES + 1), N_FRAMES]
