"""Things that move: what is known of them, what is counted, and how it is shown beside raw depth."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scenarios.evaluation import GHOST_FRAMES, Departures, SimulatedSource
from sim.recording import Recording, RecordingWriter
from tests.evaluation_clips import (
    CAMERA,
    POST_M,
    WALL_M,
    capture_of,
    evaluation_frames,
    info_of,
    key_of,
    truth_of,
    write_recording,
)
from voxdepth.tools.evaluation.groups import TRUE_GROUPS
from voxdepth.tools.evaluation.measurements import Measurement
from voxdepth.tools.evaluation.quantities import QUANTITIES
from voxdepth.tools.evaluation.report import method_table
from voxdepth.tools.evaluation.result_cache import Result
from voxdepth.tools.evaluation.scoring import Score
from voxdepth.tools.evaluation.sources import EvaluationFrame, FrameCache
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.types import CorrectedDepth

MOVERS = "[sequence]\nmovers = [{ radius_m = 0.3 }, { radius_m = 0.3 }]\n"
"""The post has the segmentation id 1: it is the second of two movers. The first one, id 0, is the wall's."""


def moving_recording(folder: Path, n_frames: int) -> Path:
    """The post moves, and a wall that is no mover has the id 7."""
    with RecordingWriter(folder, intrinsics=CAMERA, config_text=MOVERS) as writer:
        for index in range(n_frames):
            capture = capture_of(index)
            ids = np.where(capture.segment_id == 1, 1, 7).astype(np.int32)
            writer.append(replace(capture, segment_id=ids))
    return folder


def measurement(score: Score, *wanted: str) -> Measurement:
    (found,) = (f for f in score.measurements() if (f.metric, f.mask, f.range, f.on) == wanted)
    return found


def test_a_pixel_is_left_once_and_five_frames_later() -> None:
    """Pixels: never there; there in frame 0; in 0 and 2; always there; in 1 with another depth."""
    there = np.zeros((9, 1, 5), bool)
    there[0, 0, 1] = there[0, 0, 2] = there[2, 0, 2] = there[1, 0, 4] = True
    there[:, 0, 3] = True
    departures = Departures()
    left = []
    for index, moving in enumerate(there):
        depth_m = np.full((1, 5), 8, np.float32)
        depth_m[moving] = 2 + index
        left.append(departures.add(moving, depth_m)[0].tolist())
    expected = np.zeros((9, 5))
    expected[0 + GHOST_FRAMES, 1] = 2
    expected[2 + GHOST_FRAMES, 2] = 4
    expected[1 + GHOST_FRAMES, 4] = 3
    np.testing.assert_array_equal(left, expected)


def test_a_recording_tells_what_moves_and_it_is_never_static(tmp_path: Path) -> None:
    frames = list(SimulatedSource("post", Recording.open(moving_recording(tmp_path / "post", 8)), None).frames(8))
    still = list(SimulatedSource("still", Recording.open(write_recording(tmp_path / "still", 8)), None).frames(8))
    for index, (frame, unmoved) in enumerate(zip(frames, still, strict=True)):
        post = truth_of(index) == POST_M
        np.testing.assert_array_equal(frame.moving, post)
        np.testing.assert_array_equal(frame.static, unmoved.static & ~post)
        assert unmoved.moving is None
        assert unmoved.departed_m is None
    (first,) = (np.unique(frame.departed_m[frame.departed_m > 0]).tolist() for frame in frames[5:6])
    assert first == [POST_M], "the post has moved to the left by then"
    assert not any(frame.departed_m.any() for frame in frames[:5])
    last = truth_of(7)
    assert (last[frames[7].departed_m > 0] == WALL_M).all()


def test_what_moves_is_kept_with_the_frames(tmp_path: Path) -> None:
    frames = list(SimulatedSource("post", Recording.open(moving_recording(tmp_path / "post", 7)), None).frames(7))
    cache = FrameCache(tmp_path)
    cache.fill(frames)
    np.testing.assert_array_equal(cache[6].moving, frames[6].moving)
    np.testing.assert_array_equal(cache[6].departed_m, frames[6].departed_m)
    cache.fill(evaluation_frames(1))
    assert (cache[0].moving, cache[0].departed_m) == (None, None)


def moving_frame() -> EvaluationFrame:
    """Ten columns of the post move, ten columns of the wall were left by it; raw has a hole in half of each."""
    frame = evaluation_frames(1)[0]
    reference_m = np.full(CAMERA.shape, np.float32(WALL_M))
    moving, departed_m = np.zeros(CAMERA.shape, bool), np.zeros(CAMERA.shape, np.float32)
    moving[:, :10], departed_m[:, 10:20] = True, POST_M
    reference_m[moving] = POST_M
    raw_m = reference_m.copy()
    raw_m[:, [0, 1, 2, 3, 4, 10, 11, 12, 13, 14]] = 0
    given = replace(frame.frame, depth_m=raw_m)
    return replace(frame, frame=given, reference_m=reference_m, moving=moving, departed_m=departed_m)


def test_survival_and_ghosts_by_hand_beside_those_of_raw_depth() -> None:
    frame = moving_frame()
    remembered_m = frame.reference_m.copy()
    remembered_m[:, :2] = WALL_M  # a memory of the wall over the post
    remembered_m[:, 10:13] = POST_M  # and one of the post over the wall
    remembered_m[:, 13] = 0
    score = Score(TRUE_GROUPS, CAMERA)
    score.add(frame, CorrectedDepth.of(frame.frame, remembered_m))
    height = CAMERA.height_px
    for wanted, value, n in (
        (("survival", "moving", "all", "as given"), 0.8, 10),
        (("survival_raw", "moving", "all", "as given"), 0.5, 10),
        (("ghosts", "departed", "all", "filled"), 3 / 9, 9),
        (("ghosts_raw", "departed", "all", "filled"), 0.0, 5),
    ):
        assert measurement(score, *wanted).value == pytest.approx(value), wanted
        assert measurement(score, *wanted).n == n * height, wanted


def test_without_movers_there_are_no_such_figures() -> None:
    score = Score(TRUE_GROUPS, CAMERA)
    for frame in evaluation_frames(2):
        score.add(frame, CorrectedDepth.of(frame.frame, frame.reference_m))
    assert not {f.metric for f in score.measurements()} & {"survival", "survival_raw", "ghosts", "ghosts_raw"}
    seen_by_nobody = replace(
        evaluation_frames(1)[0], moving=np.zeros(CAMERA.shape, bool), departed_m=np.zeros(CAMERA.shape)
    )
    score.add(seen_by_nobody, CorrectedDepth.of(seen_by_nobody.frame, seen_by_nobody.reference_m))
    assert not any(f.metric == "survival" for f in score.measurements()), "a share of no pixel is left out"


def test_tables_show_raw_and_the_difference() -> None:
    score = Score(TRUE_GROUPS, CAMERA)
    frame = moving_frame()
    filled_m = np.where(frame.frame.depth_m > 0, frame.frame.depth_m, np.float32(POST_M))
    score.add(frame, CorrectedDepth.of(frame.frame, filled_m))
    result = Result(key=key_of("s", "m"), measurements=tuple(score.measurements()))
    done = Evaluation(results=(result,), sequences={"s": info_of("s")}, reused=0)
    survival, ghosts = (quantity for quantity in QUANTITIES if quantity.layout == "against raw")
    tables = [method_table(done, quantity) for quantity in (survival, ghosts)]
    assert [table.rows[0] for table in tables] == [["m", "50.0 +50.0"], ["m", "0.0 +50.0"]]
    assert [table.rows[1] for table in tables] == [["n", "480"], ["n", "240 to 480"]]
