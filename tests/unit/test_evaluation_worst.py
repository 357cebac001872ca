"""The worst frame of a recording, and the Rerun recording of it: where the best method fails, beside the best other."""

import sys
from pathlib import Path
from shutil import rmtree
from typing import Any

import cv2
import numpy as np
import pytest
import rerun as rr

from tests.commands import invoke
from tests.evaluation_clips import (
    WALL_M,
    capture_of,
    evaluation_of,
    info_of,
    method,
    result_of,
    write_recording,
)
from voxdepth.baselines.single_frame import Raw
from voxdepth.datasets import open_dataset
from voxdepth.tools.cli import explained
from voxdepth.tools.errors import ToolError
from voxdepth.tools.evaluate import requested_of
from voxdepth.tools.evaluation.methods import Method
from voxdepth.tools.evaluation.record import MethodResult
from voxdepth.tools.evaluation.references import held_out
from voxdepth.tools.evaluation.replay import record_worst
from voxdepth.tools.evaluation.suite import Plan, evaluate
from voxdepth.tools.evaluation.tiles import TILES
from voxdepth.tools.evaluation.worst import Worst, worst_frames
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics

BAD = 5
"""The frame that `Fails` gives no depth."""


class Fails(Raw):
    """Fills with the true depth of the wall, but nothing in one frame, which it knows by having seen those before."""

    def __init__(self, bad: int) -> None:
        super().__init__()
        self._seen, self._bad = 0, bad

    def process(self, frame: Frame) -> CorrectedDepth:
        filled_m = np.where(frame.depth_m > 0, frame.depth_m, np.float32(WALL_M))
        given_m = frame.depth_m if self._seen == self._bad else filled_m
        self._seen += 1
        return CorrectedDepth.of(frame, given_m)


def fails(intrinsics: Intrinsics) -> DepthCorrector:
    """For the command line, which names it."""
    return Fails(BAD)


def broken(intrinsics: Intrinsics) -> DepthCorrector:
    """For the command line, which reports it."""
    raise ValueError("broken")


def failing(bad: int, name: str = "fails") -> Method:
    return Method(name=name, make=lambda intrinsics: Fails(bad))


NEAR = method("near", lambda depth_m: np.where(depth_m > 0, depth_m, np.float32(0.8 * WALL_M)))


def counted(*pixels: int) -> tuple[tuple[int, ...], ...]:
    """Pixels of each frame, all in the first tile."""
    return tuple((n, *[0] * (TILES - 1)) for n in pixels)


def made_up(sequence: str, name: str, close: tuple[int, ...], judged: tuple[int, ...], **given: Any) -> MethodResult:
    return result_of(sequence, name, close=counted(*close), judged=counted(*judged), **given)


def worst_of(*results: MethodResult) -> Worst:
    (worst,) = worst_frames(evaluation_of(*results))
    return worst


def test_it_is_the_frame_with_the_smallest_share_of_the_best_method() -> None:
    judged = (100, 400, 200)
    best = made_up("post", "temporal", (90, 300, 140), judged)
    other = made_up("post", "raw", (10, 300, 160), judged)
    worst = worst_of(other, best)
    assert (worst.frame, worst.compared) == (2, ("temporal", "raw"))
    np.testing.assert_allclose(worst.shares["raw"], [0.1, 0.75, 0.8])
    assert worst.sentence(900) == (
        "post: temporal (ours) is worst in frame 902: it gives 70.0 % of the judged pixels of the own holes a depth "
        "within 5 % (75.7 % in all frames), and raw 80.0 %."
    )


def test_a_frame_of_few_judged_pixels_is_not_the_worst_and_of_equal_ones_it_is_that_of_most() -> None:
    assert worst_of(made_up("post", "raw", (0, 80, 90, 0), (5, 100, 100, 0))).frame == 1
    assert worst_of(made_up("post", "raw", (0, 0, 0), (50, 100, 60))).frame == 1
    assert worst_of(made_up("post", "raw", (100, 100), (100, 100))).frame == 0, "one that makes no error has one, too"


def test_it_is_that_of_all_kinds_of_pixels_and_a_method_that_failed_in_one_is_not_shown() -> None:
    results = []
    for mask, close, is_broken in (("patches", (90, 80), False), ("shadows", (95, 70), True)):
        name = f"walk-{mask}"
        info = {"info": info_of(name, recording="walk", reference=held_out(mask))}
        results.append(made_up(name, "temporal", close, (100, 100), **info))
        results.append(made_up(name, "median", (10, 10), (100, 100), **info))
        failed, perfect = result_of(name, "better", error="broken", **info), ((100, 100), (100, 100))
        results.append(failed if is_broken else made_up(name, "better", *perfect, **info))
    worst = worst_of(*results)
    assert (worst.info.name, worst.frame, worst.compared) == ("walk-shadows", 1, ("temporal", "median"))
    assert list(worst.shares) == ["temporal", "median"]


def test_a_recording_in_which_nothing_was_judged_has_none() -> None:
    assert not worst_frames(evaluation_of(made_up("post", "raw", (0, 0), (0, 0))))
    assert not worst_frames(evaluation_of(result_of("post", "raw", error="broken")))


def evaluated(folder: Path, out: Path, *methods: Method, frames: int = 8) -> tuple[Plan, list[Worst]]:
    plan = Plan(sequences=requested_of(folder, open_dataset), methods=methods, frames=frames, out=out)
    return plan, worst_frames(evaluate(plan, lambda what, finished: None))


def rows(path: Path, entity: str) -> dict[int | None, dict[str, Any]]:
    """What an entity holds, by the frame; that of no frame holds always."""
    found: dict[int | None, dict[str, Any]] = {}
    for chunk in rr.chunk.RrdReader(path).stream().filter(content=entity).to_chunks():
        for row in chunk.to_record_batch().to_pylist():
            found.setdefault(row.get("frame"), {}).update(row)
    return found


def picture(path: Path, entity: str, frame: int) -> Any:
    blob = rows(path, entity)[frame]["EncodedImage:blob"]
    return cv2.imdecode(np.array(blob, np.uint8).ravel(), cv2.IMREAD_COLOR)


@pytest.mark.parametrize("bad", [0, BAD, 7])
def test_the_frame_in_which_a_method_fails_is_recorded_with_those_around_it(tmp_path: Path, bad: int) -> None:
    plan, (worst,) = evaluated(write_recording(tmp_path / "post"), tmp_path / "out", NEAR, failing(bad), method("raw"))
    assert (worst.frame, worst.compared) == (bad, ("fails", "near"))
    path, done = tmp_path / "post.rrd", list[int]()
    record_worst(path, plan, worst, 0, done.append)
    shown = [k for k in range(8) if abs(k - bad) <= 3]
    assert done == list(range(1, shown[-1] + 2))
    for entity in ("gray", "colors/raw", "depth/reference", "methods/near/depth/corrected", "methods/fails/confidence"):
        assert sorted(rows(path, f"/{entity}"), key=str) == shown, entity
    for name, of_frames in {
        "fails": [100.0 * (k != bad) for k in range(8)],
        "near": [0.0] * 8,
        "raw": [0.0] * 8,
    }.items():
        curve = rows(path, f"/shares/{name}")
        assert [curve[k]["Scalars:scalars"] for k in range(8)] == [[share] for share in of_frames]
    assert [k for k in rows(path, "/worst") if k is not None] == [bad]
    capture = capture_of(bad)
    errors = {name: picture(path, f"/methods/{name}/colors/error", bad) for name in ("fails", "near")}
    inside = cv2.erode(capture.occluded.astype(np.uint8), np.ones((3, 3))).astype(bool)
    outside = cv2.erode((~capture.occluded).astype(np.uint8), np.ones((9, 9))).astype(bool)
    assert errors["fails"][inside].max() < 60, "black: no depth"
    assert (errors["near"][inside] @ [-1, -1, 2]).min() > 250, "red: too near"
    assert np.abs(errors["near"][outside].astype(int) - 160).max() < 25, "gray: not judged"
    other = shown[0] if bad else 1
    inside &= cv2.erode(capture_of(other).occluded.astype(np.uint8), np.ones((3, 3))).astype(bool)
    assert picture(path, "/methods/fails/colors/error", other)[inside].min() > 220, "white: right"


def rows_without_ids(path: Path) -> list[str]:
    chunks = rr.chunk.RrdReader(path).stream().to_chunks()
    found = [row for chunk in chunks for row in chunk.to_record_batch().to_pylist()]
    return sorted(str({**row, "rerun.controls.RowId": None}) for row in found)


def test_a_recording_without_the_truth_is_shown_as_it_is_although_methods_are_given_mirrored_images(
    tmp_path: Path,
) -> None:
    rmtree(write_recording(tmp_path / "plain") / "depth_true")
    plan, (worst,) = evaluated(tmp_path / "plain", tmp_path / "out", NEAR, failing(BAD), frames=7)
    assert worst.info.reference.is_mirrored
    assert worst.frame == BAD
    for name in ("one", "other"):
        record_worst(tmp_path / f"{name}.rrd", plan, worst, 40, lambda done: None)
    path = tmp_path / "one.rrd"
    frame = 40 + BAD
    assert sorted(rows(path, "/gray"), key=str) == list(range(frame - 3, 47)), "by the numbers of the recording"
    gray = picture(path, "/gray", frame)[..., 0].astype(int)
    assert np.abs(gray - capture_of(BAD).gray_left).mean() < 3
    reference = rows(path, "/depth/reference")[frame]["EncodedDepthImage:blob"]
    reference_cm = cv2.imdecode(np.array(reference, np.uint8).ravel(), cv2.IMREAD_UNCHANGED)
    np.testing.assert_allclose(reference_cm / 100, capture_of(BAD).depth_raw_m, rtol=0.02)
    assert rows_without_ids(path) == rows_without_ids(tmp_path / "other.rrd"), "the same frames give the same recording"


def test_a_method_that_fails_only_when_it_corrects_again_leaves_no_recording(tmp_path: Path) -> None:
    plan, (worst,) = evaluated(write_recording(tmp_path / "post", 3), tmp_path / "out", NEAR, failing(1), frames=3)
    other = method("near", lambda depth_m: depth_m[1:])
    again = Plan(sequences=plan.sequences, methods=[other, failing(1)], frames=3, out=plan.out)
    with pytest.raises(ToolError, match=r"^post cannot be corrected again for its recording: frame 0: "):
        record_worst(tmp_path / "worst" / "post.rrd", again, worst, 0, lambda done: None)
    assert not list((tmp_path / "worst").iterdir())


def test_the_command_says_which_frame_is_the_worst_and_how_to_look_at_it(tmp_path: Path) -> None:
    folder, out = write_recording(tmp_path / "post"), tmp_path / "out"
    methods = f"raw,{__name__}:fails,{__name__}:broken"
    done = invoke("evaluate", "--data", folder, "--methods", methods, "--frames", "7", "--out", out, "--record")
    assert done.exit_code == 1, done.output
    assert "1 of 3 results failed" in done.stderr, "and the others are recorded all the same"
    path = out / "worst" / "post.rrd"
    said, look = done.stdout.splitlines()[-2:]
    assert said.startswith(
        f"post: {__name__}:fails is worst in frame {BAD}: it gives 0.0 % of the judged pixels of the "
    )
    assert said.endswith(" in all frames), and raw 0.0 %.")
    assert look == f"look at it with: voxdepth view {path}"
    entity = rr.escape_entity_path_part(f"{__name__}:fails")
    assert BAD in rows(path, f"/methods/{entity}/depth/corrected")
    assert [one.name for one in (out / "worst").iterdir()] == ["post.rrd"]


def test_a_missing_viewer_is_named_before_anything_is_evaluated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)  # Python's mark of a missing package.
    done = invoke("evaluate", "--data", write_recording(tmp_path / "post", 2), "--out", tmp_path / "out", "--record")
    assert explained(done.exception) == "this needs the package rerun-sdk: pip install 'voxdepth[rerun]'"
    assert not (tmp_path / "out").exists()
