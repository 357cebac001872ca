"""The suite: results are kept and reused, failures stop nothing else, and a repetition gives the same figures."""

import errno
import json
import os
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from shutil import rmtree
from types import SimpleNamespace
from typing import Any
from unittest import mock

import cv2
import numpy as np
import pytest

from scenarios.evaluation import Shipped, SimulatedSource
from scenarios.sequences import load_sequence
from sim.recording import Recording, RecordingWriter
from tests.commands import invoke
from tests.damage import DAMAGES
from tests.evaluation_clips import CAMERA, capture_of, method, shadow_of, truth_of, write_recording
from voxdepth.checksums import LIST
from voxdepth.datasets import open_dataset
from voxdepth.datasets.files import LARGEST_FILE_BYTES
from voxdepth.tools.errors import ToolError
from voxdepth.tools.evaluate import requested_of
from voxdepth.tools.evaluation import frames, suite
from voxdepth.tools.evaluation.measurements import Selector, select
from voxdepth.tools.evaluation.methods import Method, find_methods
from voxdepth.tools.evaluation.record import RECORDS, MethodResult, load, path_of, store
from voxdepth.tools.evaluation.recordings import HELD_OUT, RecordedSource
from voxdepth.tools.evaluation.suite import Evaluation, Plan, evaluate
from voxdepth.tools.files import locked, to_toml
from voxdepth.tools.recorded import Opener
from voxdepth.tools.results.store import unsealed_json

GOOD = method("good")
BAD = method("bad", lambda depth_m: depth_m[:-1])


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("data") / "post")


def run(out: Path, *folders: Path, methods: tuple[Method, ...] = (GOOD, BAD), frames: int = 4) -> Evaluation:
    sequences = [requested for folder in folders for requested in requested_of(folder, open_dataset)]
    plan = Plan(sequences=sequences, methods=methods, frames=frames, out=out)
    return evaluate(plan, lambda what, done: None)


def quality(result: MethodResult) -> Any:
    return [m for m in result.measurements if m.on != "frames"]


def test_a_repetition_elsewhere_gives_the_same_quality_bit_for_bit(recording: Path, tmp_path: Path) -> None:
    methods = tuple(find_methods(["raw", "voxdepth", "median", "lmeds"]))
    one, other = (run(tmp_path / name, recording, methods=methods, frames=8) for name in "ab")
    assert [result.error for result in one.results] == [None] * 4
    assert [quality(result) for result in one.results] == [quality(result) for result in other.results]
    assert one.sequences == other.sequences


def test_two_evaluations_do_not_write_to_one_folder(recording: Path, tmp_path: Path) -> None:
    with locked(tmp_path, "busy"), pytest.raises(ToolError, match="another evaluation writes to"):
        run(tmp_path, recording)


def test_windows_locks_by_its_own_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []

    def locking(descriptor: int, mode: int, count: int) -> None:
        if taken:
            raise PermissionError(errno.EACCES, "Permission denied")
        taken.append(mode)

    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setitem(sys.modules, "fcntl", None)  # There is none.
    monkeypatch.setitem(sys.modules, "msvcrt", SimpleNamespace(locking=locking, LK_NBLCK=2))
    with locked(tmp_path, "busy"), pytest.raises(ToolError, match="busy"), locked(tmp_path, "busy"):
        pass
    assert taken == [2]


def test_finished_results_are_taken_and_failed_ones_tried_again(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = run(tmp_path, recording)
    ran: list[str] = []
    really = suite.run

    def watched(method: Method, *rest: Any) -> Any:
        ran.append(method.name)
        return really(method, *rest)

    monkeypatch.setattr(suite, "run", watched)
    again = run(tmp_path, recording)
    assert (again.reused, ran) == (1, ["bad"])
    assert again.results == first.results
    ran.clear()
    mended = run(tmp_path, recording, methods=(GOOD, method("bad"), method("new")))
    assert ran == ["bad", "new"]
    assert [result.error for result in mended.results] == [None] * 3
    ran.clear()
    assert run(tmp_path, recording, methods=(GOOD, method("bad"))).reused == 2
    assert not ran


def with_key(data: bytes, **changes: Any) -> bytes:
    stored = unsealed_json(data)
    return json.dumps(stored | {"key": stored["key"] | changes}).encode()


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: with_key(data, versions={"numpy": "1.0"}),
        lambda data: with_key(data, config={"size": 3}),
        lambda data: with_key(data, digest="0" * 64),
        lambda data: data[:300],
        lambda data: b"\xff",
        lambda data: json.dumps({**unsealed_json(data), "colour": "red"}).encode(),
        DAMAGES["a wrong byte in the middle"],
    ],
)
def test_a_result_of_anything_else_or_damaged_or_of_another_layout_is_computed_again(
    recording: Path, tmp_path: Path, spoil: Callable[[bytes], bytes]
) -> None:
    (result,) = run(tmp_path, recording, methods=(GOOD,)).results
    path = path_of(tmp_path, result.sequence, result.method)
    path.write_bytes(spoil(path.read_bytes()))
    again = run(tmp_path, recording, methods=(GOOD,))
    assert (again.reused, quality(again.results[0])) == (0, quality(result))
    assert RECORDS.decode(path.read_bytes()) == replace(again.results[0], info=None)


def test_other_sources_or_another_number_of_frames_are_another_result(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(tmp_path, recording, methods=(GOOD,))
    with monkeypatch.context() as patch:
        patch.setattr(suite, "code_digest", lambda sources: "another")
        assert run(tmp_path, recording, methods=(GOOD,)).reused == 0
    assert run(tmp_path, recording, methods=(GOOD,), frames=5).reused == 0
    (all_there_are,) = run(tmp_path, recording, methods=(GOOD,), frames=500).results
    assert all_there_are.key["frames"] == 8


def test_a_result_is_not_taken_for_that_of_another_method_whose_file_has_its_name(tmp_path: Path) -> None:
    store(tmp_path, MethodResult(sequence="walk", method="mine:a", key={"frames": 1}))
    assert load(tmp_path, "walk", "mine:a", {"frames": 1}) is not None
    assert load(tmp_path, "walk", "mine/a", {"frames": 1}) is None


def test_foreign_code_is_run_again_every_time(recording: Path, tmp_path: Path) -> None:
    (first,) = run(tmp_path, recording, methods=(replace(GOOD, is_foreign=True),)).results
    changed = replace(method("good", np.zeros_like), is_foreign=True)
    done = run(tmp_path, recording, methods=(changed,))
    assert done.reused == 0
    assert quality(done.results[0]) != quality(first)


@pytest.mark.parametrize("has_truth", [True, False])
def test_a_recording_without_a_whole_frame_is_an_error_of_its_results(tmp_path: Path, has_truth: bool) -> None:
    folder = write_recording(tmp_path / "none", 0)
    (folder / "depth_true").mkdir(exist_ok=True)
    if not has_truth:
        (folder / "depth_true").rmdir()
    done = run(tmp_path / "out", folder, methods=(GOOD,))
    assert done.results[0].error is not None
    assert ("no whole frame" in done.results[0].error) == has_truth


def test_a_folder_whose_name_is_no_text_is_refused_before_anything_is_written(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"caf\xe9")
    with pytest.raises(ToolError, match=r"in UTF-8, got 'caf\\udce9-shadows': rename the folder"):
        run(tmp_path / "out", folder)
    assert not (tmp_path / "out").exists()


def test_frames_that_cannot_be_kept_are_an_error_of_the_results(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(28, "No space left on device")
    monkeypatch.setattr(frames.np, "save", mock.Mock(side_effect=full))
    for result in run(tmp_path, recording).results:
        assert result.error == "cannot keep frame 0: No space left on device"


def test_a_sequence_that_cannot_be_opened_fails_in_its_own_results_alone(recording: Path, tmp_path: Path) -> None:
    maskless = write_recording(tmp_path / "maskless", 3)
    for image in (maskless / "occluded").iterdir():
        image.unlink()
    (tmp_path / "empty").mkdir()
    done = run(tmp_path / "out", maskless, tmp_path / "empty", recording)
    errors = {(result.sequence, result.method): result.error for result in done.results}
    assert "occluded" in (errors["maskless", "good"] or "")
    assert errors["maskless", "good"] == errors["maskless", "bad"]
    assert "holds no dataset" in (errors["empty-shadows", "good"] or "")
    assert errors["post", "good"] is None
    assert set(done.sequences) == {"post"}
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"results", "write.lock"}, "nothing is left behind"


def test_two_sequences_of_one_name_are_refused(recording: Path, tmp_path: Path) -> None:
    with pytest.raises(ToolError, match="two sequences are called 'post'"):
        run(tmp_path, recording, recording)
    plain = plain_recording(tmp_path / "post", 1)
    with pytest.raises(ToolError, match="two sequences are called 'post', whose results would mix"):
        run(tmp_path, recording, plain)


def test_the_truth_splits_pixels_as_computed_by_hand(recording: Path) -> None:
    source = SimulatedSource("post", Recording.open(recording), None)
    frames = list(source.frames(3))
    for index, frame in enumerate(frames):
        truth_m = truth_of(index)
        shadow = shadow_of(truth_m)
        np.testing.assert_array_equal(frame.occluded, shadow)
        np.testing.assert_array_equal(frame.hidden, shadow)
        assert frame.frame.T_world_cam is None
    assert not frames[0].static.any()
    moved = truth_of(2) != truth_of(1)
    np.testing.assert_array_equal(frames[2].static, ~moved)


def plain_recording(folder: Path, frames: int) -> Path:
    """The recording without its truth."""
    write_recording(folder, frames)
    rmtree(folder / "depth_true")
    return folder


def test_a_recording_without_the_truth_is_scored_by_each_kind_that_is_held_out(tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "plain", 3)
    methods = (GOOD, *find_methods(["ip-basic"]))
    done = run(tmp_path / "out", folder, methods=methods, frames=3)
    *held_out, holes = done.sequences.items()
    assert [name for name, _ in held_out] == ["plain-shadows", "plain-wide-shadows", "plain-patches"]
    assert (holes[0], holes[1].pixels) == ("plain-holes", 0), "images without features tell no pose"
    for name, info in held_out:
        mask = name.removeprefix("plain-")
        coverage = Selector("coverage", mask, on="filled")
        assert info.hidden > 0
        assert select(done.measurements, coverage).loc[name, "value"].to_dict() == {"good": 0, "ip-basic": 1}


def test_an_evaluation_begins_with_a_later_frame_where_no_truth_is_that_of_the_first(tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "plain", 3)
    for one in requested_of(folder, Opener(None, 20, start=1)):
        source = one.open(tmp_path, 2, lambda what: None)
        assert len(source) == 2 and next(iter(source.frames(1))).frame.stamp_s == open_dataset(folder)[1].stamp_s
    write_recording(tmp_path / "with truth", 3)
    for of in (["sim-LN"], ["--data", tmp_path / "with truth"]):
        done = invoke("evaluate", *of, "--start", "1", "--out", tmp_path / "out")
        assert "--start 1 is for recordings of real cameras (--data)" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_held_out_shadows_lie_to_the_left_of_near_objects_in_mirrored_images(tmp_path: Path) -> None:
    source = RecordedSource("s", open_dataset(plain_recording(tmp_path / "plain", 3)), HELD_OUT["shadows"])
    frame = list(source.frames(3))[1]
    held_out = frame.hidden
    raw_m = capture_of(1).depth_raw_m[:, ::-1]
    assert source.intrinsics.cx_px == CAMERA.width_px - 1 - CAMERA.cx_px
    assert 0.02 < held_out.mean() < 0.2
    assert not frame.frame.depth_m[held_out].any()
    np.testing.assert_array_equal(frame.reference_m[held_out], raw_m[held_out])
    np.testing.assert_array_equal(frame.frame.depth_m[~held_out], raw_m[~held_out])
    np.testing.assert_array_equal(frame.frame.gray, capture_of(1).gray_left[:, ::-1])
    post = np.flatnonzero(frame.frame.gray[20] == 200)
    assert np.flatnonzero(held_out[20]).max() == post.min() - 1


def test_the_sensors_own_holes_are_scored_by_a_true_depth_of_the_first_frame(tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "real", 2)
    truth_mm = (1000 * truth_of(0)).astype(np.uint16)
    truth_mm[:8] = 0
    cv2.imwrite(str(folder / "depth_true_mm.png"), truth_mm)
    done = run(tmp_path / "out", folder, methods=(GOOD, method("wall", lambda d: np.full_like(d, 6))), frames=2)
    info = done.sequences["real-holes"]
    (shares,) = (shares for shares in done.shares if shares.recording == "real")
    evaluated = shadow_of(truth_of(0))[8:].sum()
    assert (shares.kinds["real-holes"].evaluated, shares.kinds["real-holes"].pixels) == (evaluated, info.hidden)
    assert info.hidden > 2 * evaluated, "the second frame has no truth, and the first one some above"
    assert info.pixels == truth_mm[8:].size, "the second frame has no truth"
    close = Selector("close", "holes", on="as given")
    assert select(done.measurements, close).loc["real-holes", "value"].to_dict() == {"good": 0, "wall": 1}


def test_every_frame_may_have_a_true_depth_of_its_name(tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "real", 3)
    (folder / "depth_true").mkdir()
    for index in (0, 2):
        truth_mm = (1000 * truth_of(index)).astype(np.uint16)
        cv2.imwrite(str(folder / "depth_true" / f"{index:06d}.png"), truth_mm)
    holes = requested_of(folder, open_dataset)[-1]
    assert holes.name == "real-holes"
    frames = list(holes.open(tmp_path, 3, lambda what: None).frames(3))
    for index, expected_m in ((0, truth_of(0)), (1, 0 * truth_of(1)), (2, truth_of(2))):
        np.testing.assert_allclose(frames[index].reference_m, expected_m)


@pytest.mark.parametrize(("name", "kind"), [("depth_true_mm", np.uint16), ("gray_left/000002", np.uint8)])
def test_another_true_depth_or_later_frame_is_another_sequence_of_holes(name: str, kind: Any, tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "real", 3)
    (folder / LIST).unlink()
    digests = []
    for value in (40, 50):
        cv2.imwrite(str(folder / f"{name}.png"), np.full(CAMERA.shape, value, kind))
        digests.append(
            [one.open(tmp_path, 1, lambda what: None).digest(1) for one in requested_of(folder, open_dataset)]
        )
    assert [one == other for one, other in zip(*digests, strict=True)] == [True, True, True, False]


def test_a_true_depth_that_cannot_be_read_fails_its_holes_alone(tmp_path: Path) -> None:
    folder = plain_recording(tmp_path / "real", 2)
    (folder / "depth_true_mm.png").touch()
    os.truncate(folder / "depth_true_mm.png", LARGEST_FILE_BYTES + 1)
    failed = run(tmp_path / "out", folder, methods=(GOOD,), frames=2).failures
    assert [one.sequence for one in failed] == ["real-holes"]
    assert "depth_true_mm.png" in str(failed[0].error)


def test_a_shipped_sequence_is_recorded_once_and_only_if_it_must_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def record(planned: Any, folder: Path, frames: int, progress: Callable[[int], None]) -> None:
        made.append(frames)
        with RecordingWriter(folder, intrinsics=CAMERA, config_text=to_toml(planned)) as writer:
            for index in range(frames):
                writer.append(capture_of(index))
                progress(index + 1)

    monkeypatch.setattr("scenarios.sequences.record", record)
    requested = Shipped(load_sequence("sim-LN", 3, {}))
    message: list[str] = []
    source = requested.open(tmp_path, 4, message.append)
    assert isinstance(source, SimulatedSource)
    assert (source.seed, len(source), message[-1]) == (3, 4, "recording sim-LN, frame 4 of 4")
    requested.open(tmp_path, 3, message.append)
    assert made == [4]
    (folder,) = (tmp_path / "recordings").iterdir()
    for name in ("config.toml", "depth_raw/000002.tiff", "segment/000003.png"):
        (folder / name).write_bytes(DAMAGES["a wrong byte in the middle"]((folder / name).read_bytes()))
        assert requested.open(tmp_path, 4, message.append).digest(4)
        assert made.pop() == 4, "it is made again"
    assert made == [4]
    other = Shipped(load_sequence("sim-LN", 4, {}))
    done = evaluate(Plan(sequences=[other], methods=[GOOD], frames=3, out=tmp_path), lambda what, n: None)
    assert (done.results[0].error, done.sequences["sim-LN"].seed) == (None, 4)
    assert requested.open(tmp_path, 4, message.append).seed == 3
    assert made == [4, 3], "each seed has a recording of its own"
    names = [folder.name for folder in (tmp_path / "recordings").iterdir()]
    assert len(names) == 2
    assert all(re.fullmatch("sim-LN-[0-9a-f]{12}", name) for name in names)
