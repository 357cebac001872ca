"""What is scored, by hand: masks, errors, flicker, and things that move."""

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
    Change,
    capture_of,
    evaluation_frames,
    evaluation_of,
    result_of,
    scores_of,
    truth_of,
    write_recording,
)
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import Sums
from voxdepth.tools.evaluation import tiles
from voxdepth.tools.evaluation.frames import RANGES, TRUTH, EvaluationFrame, FrameFile, Reference
from voxdepth.tools.evaluation.measurements import MetricValue
from voxdepth.tools.evaluation.quantities import QUANTITIES
from voxdepth.tools.evaluation.references import held_out
from voxdepth.tools.evaluation.report import method_table, range_table
from voxdepth.tools.evaluation.scoring import METRICS, SETTLED_FRAMES, Scorer
from voxdepth.types import CorrectedDepth, Frame

PATCHES = held_out("patches")
MOVERS = "[sequence]\nmovers = [{ radius_m = 0.3 }, { radius_m = 0.3 }]\n[versions]\n"
"""The post has the segmentation id 1: it is the second of two movers. The first one, id 0, is the wall's."""
NEAR_FILLED = ("all", "0-20 m", "filled")


def scored(change: Change, reference: Reference = TRUTH) -> dict[tuple[str, ...], MetricValue]:
    return scores_of(reference, evaluation_frames(4), change)


@pytest.mark.parametrize("reference", [TRUTH, PATCHES])
def test_what_is_measured_of_a_mask_is_of_these_pixels_within_20_m(reference: Reference) -> None:
    rng, shape = np.random.default_rng(0), CAMERA.shape
    truth_m = rng.choice([0, 0.5, 2, 3, 5, 9, 10, 20, 60, np.inf], shape).astype(np.float32)
    depth_m = rng.choice([0, 1, 2, 8, 30], shape).astype(np.float32)
    hidden, occluded = rng.random(shape) < 0.3, rng.random(shape) < 0.2
    frame = replace(evaluation_frames(1)[0], reference_m=truth_m, hidden=hidden, occluded=occluded)
    assert frame.known().sum() == (truth_m > 0).sum() - np.isinf(truth_m).sum()
    done = scores_of(reference, [frame], lambda _: depth_m)
    masks = {"all": hidden | ~hidden, "measured": ~hidden, reference.hidden: hidden, "occluded": occluded}
    for mask, pixels in masks.items():
        expected = Sums.of(depth_m, truth_m, pixels & (truth_m < 20))
        found = done["mae", mask, "0-20 m", "filled"]
        assert (found.value, found.n) == (pytest.approx(expected.mae_m), expected.filled), mask
        assert done["coverage", mask, "0-20 m", "filled"].n == expected.pixels
        assert done["close", mask, "0-20 m", "as given"].value == pytest.approx(expected.close / expected.pixels)


def test_a_perfect_method_has_no_error() -> None:
    truths_m = map(truth_of, range(4))
    done = scored(lambda depth_m: next(truths_m))
    for metric in METRICS:
        assert done[metric, "all", "0-20 m", "completed"].value == 0, metric
    assert done["flicker", "static", "0-20 m", "filled"].value == 0
    assert done["coverage", "holes", "0-20 m", "filled"].value == 1


def test_figures_are_those_of_the_whole_image_at_once() -> None:
    done = scored(lambda depth_m: depth_m * np.float32(1.05))
    given_m = np.array([frame.frame.depth_m * np.float32(1.05) for frame in evaluation_frames()])
    truth_m = np.array([frame.reference_m for frame in evaluation_frames()], np.float64)
    completed_m = np.array(list(map(fill_from_nearest, given_m)))
    filled, everywhere = np.abs(given_m - truth_m)[given_m > 0], np.abs(completed_m - truth_m)
    for on, errors_m in (("filled", filled), ("completed", everywhere)):
        found = done["mae", "all", "0-20 m", on]
        assert (found.value, found.n) == (pytest.approx(errors_m.mean(), rel=1e-6), errors_m.size)
    assert done["coverage", *NEAR_FILLED].value == pytest.approx(filled.size / everywhere.size)


def test_unfilled_pixels_do_not_hide() -> None:
    left = np.arange(CAMERA.width_px) == 0
    done = scored(lambda depth_m: np.where(left, np.float32(WALL_M), np.float32(0) * depth_m))
    assert done["mae", "all", "0-20 m", "filled"].value == 0 and done["mae", "all", "0-20 m", "completed"].value > 0.3
    assert (
        done["mae", "holes", "0-20 m", "filled"].value is None
        and done["coverage", "holes", "0-20 m", "filled"].value == 0
    )


def test_the_close_pixels_of_each_frame_and_tile_are_those_of_hidden_ones_that_a_method_fills() -> None:
    frames, score = evaluation_frames(2), Scorer(TRUTH, CAMERA)
    for frame, depth_m in zip(frames, (frames[0].reference_m, frames[1].frame.depth_m), strict=True):
        score.add(frame, CorrectedDepth.of(frame.frame, depth_m))
    holes = tuple(tuple(tiles.count(frame.hidden).tolist()) for frame in frames)
    assert score.judged == holes
    assert score.close == (holes[0], (0,) * tiles.TILES)


def test_mirrored_images_are_counted_in_the_tiles_of_the_recording() -> None:
    """Kinds of pixels share their pixels, so that what one pixel shows is drawn once for all of them."""
    frame = evaluation_frames(1)[0]
    left = np.broadcast_to(np.arange(CAMERA.width_px) < 5, CAMERA.shape)
    for is_mirrored, column in ((False, 0), (True, tiles.COLUMNS - 1)):
        score = Scorer(held_out("shadows", is_mirrored=is_mirrored), CAMERA)
        score.add(replace(frame, hidden=left), CorrectedDepth.of(frame.frame, frame.reference_m))
        counts = np.reshape(score.close, (tiles.ROWS, tiles.COLUMNS))
        assert np.flatnonzero(counts.any(axis=0)).tolist() == [column]
        assert counts.sum() == left.sum()


def test_a_frame_given_wholly_empty_leaves_no_figure_after_completion() -> None:
    truths_m = iter([truth_of(0), 0 * truth_of(1), truth_of(2), truth_of(3)])
    done = scored(lambda depth_m: next(truths_m))
    for metric in METRICS:
        assert done[metric, "all", "0-20 m", "completed"].value is None, metric
        assert done[metric, *NEAR_FILLED].value is not None, metric


def test_settled_errors_leave_the_warm_up_out() -> None:
    n = SETTLED_FRAMES + 2
    factors = iter([1.1, *[1] * (n - 1)])
    frames = evaluation_frames(n)
    truths_m = iter([frame.reference_m for frame in frames])
    done = scores_of(TRUTH, frames, lambda _: next(truths_m) * np.float32(next(factors)))
    settled = done["psnr16_mm_settled", "all", "all", "completed"]
    assert (settled.value, settled.n) == (np.inf, 2 * CAMERA.width_px * CAMERA.height_px)
    assert done["rmse_settled", "occluded", "0-20 m", "completed"].value == 0


def test_without_the_truth_held_out_pixels_are_evaluated_and_the_change_of_depth_is_flicker() -> None:
    frame, hidden = evaluation_frames(1)[0], np.zeros(CAMERA.shape, bool)
    hidden[:, :10] = True
    labelled = replace(frame, hidden=hidden, occluded=None, static=np.ones(CAMERA.shape, bool))
    changes_m, off_m = iter([0, 0.1, 0]), np.float32(0.5) * hidden
    done = scores_of(PATCHES, [labelled] * 3, lambda _: frame.reference_m + off_m + np.float32(next(changes_m)))
    flicker = [found for (metric, mask, *_), found in done.items() if (metric, mask) == ("flicker", "static")]
    assert [(found.range, found.value) for found in flicker] == [("0-20 m", pytest.approx(0.1, rel=1e-4))]
    found = scores_of(PATCHES, [labelled], lambda _: frame.reference_m + off_m)["mae", "patches", "0-20 m", "completed"]
    assert (found.value, found.n) == (pytest.approx(0.5, rel=1e-5), hidden.sum())


def test_a_pixel_is_left_once_and_five_frames_later() -> None:
    """Pixels: never there; there in frame 0; in 0 and 2; always there; in 1 with another depth."""
    there = np.zeros((9, 1, 5), bool)
    there[0, 0, 1] = there[0, 0, 2] = there[2, 0, 2] = there[1, 0, 4] = True
    there[:, 0, 3] = True
    departures = Departures()
    depths_m = [np.where(moving, 2 + index, 8).astype(np.float32) for index, moving in enumerate(there)]
    left = [departures.add(moving, depth_m)[0].tolist() for moving, depth_m in zip(there, depths_m, strict=True)]
    expected = np.zeros((9, 5))
    expected[[0 + GHOST_FRAMES, 2 + GHOST_FRAMES, 1 + GHOST_FRAMES], [1, 2, 4]] = 2, 4, 3
    np.testing.assert_array_equal(left, expected)


def test_a_recording_tells_what_moves_which_is_never_static_and_is_kept_with_the_frames(tmp_path: Path) -> None:
    with RecordingWriter(tmp_path / "post", intrinsics=CAMERA, config_text=MOVERS) as writer:
        for capture in map(capture_of, range(8)):  # The wall is no mover: it has the id 7.
            writer.append(replace(capture, segment_id=np.where(capture.segment_id == 1, 1, 7).astype(np.int32)))
    write_recording(tmp_path / "still")
    moving, still = (
        list(SimulatedSource(name, Recording.open(tmp_path / name), None).frames(8)) for name in ("post", "still")
    )
    for index, (frame, unmoved) in enumerate(zip(moving, still, strict=True)):
        post = truth_of(index) == POST_M
        np.testing.assert_array_equal(frame.moving, post)
        np.testing.assert_array_equal(frame.static, unmoved.static & ~post)
        assert unmoved.moving is None and unmoved.departed_m is None
    assert not any(frame.departed_m.any() for frame in moving[:5])
    assert set(np.unique(moving[5].departed_m)) == {0, POST_M}, "the post has moved to the left by then"
    assert (truth_of(7)[moving[7].departed_m > 0] == WALL_M).all()
    with FrameFile(tmp_path) as file:
        file.fill(moving)
        for _ in range(2):
            read = list(file)
            assert len(read) == len(file) == 8
            for image in ("reference_m", "hidden", "static", "occluded", "moving", "departed_m"):
                np.testing.assert_array_equal(getattr(read[6], image), getattr(moving[6], image))
            for value in ("stamp_s", "gray", "depth_m"):
                np.testing.assert_array_equal(getattr(read[6].frame, value), getattr(moving[6].frame, value))


def moving_frame() -> EvaluationFrame:
    """Ten columns of the post move, ten columns of the wall were left by it; raw has a hole in half of each."""
    frame, columns = evaluation_frames(1)[0], np.broadcast_to(np.arange(CAMERA.width_px), CAMERA.shape)
    moving, left = columns < 10, (columns >= 10) & (columns < 20)
    reference_m = np.where(moving, np.float32(POST_M), np.float32(WALL_M))
    raw_m = np.where((columns < 20) & (columns % 10 < 5), np.float32(0), reference_m)
    departed_m = np.where(left, np.float32(POST_M), np.float32(0))
    given = replace(frame.frame, depth_m=raw_m)
    return replace(frame, frame=given, reference_m=reference_m, moving=moving, departed_m=departed_m)


def test_survival_and_ghosts_by_hand_beside_those_of_raw_depth_in_scores_and_tables() -> None:
    frame = moving_frame()
    remembered_m = frame.reference_m.copy()
    remembered_m[:, :2] = WALL_M  # a memory of the wall over the post
    remembered_m[:, 10:13] = POST_M  # and one of the post over the wall
    remembered_m[:, 13] = 0
    done = scores_of(TRUTH, [frame], lambda _: remembered_m)
    for wanted, value, n in (
        (("survival", "moving", "all", "as given"), 0.8, 10),
        (("survival_raw", "moving", "all", "as given"), 0.5, 10),
        (("ghosts", "departed", "all", "filled"), 3 / 9, 9),
        (("ghosts_raw", "departed", "all", "filled"), 0.0, 5),
    ):
        assert (done[wanted].value, done[wanted].n) == (pytest.approx(value), n * CAMERA.height_px), wanted
    result = result_of("s", "m", *done.values())
    tables = [
        method_table(evaluation_of(result), q).rows for q in QUANTITIES if q.title.startswith(("Survival", "Ghosts"))
    ]
    assert tables == [[["m", "80.0 / 50.0"], ["n", "480"]], [["m", "33.3 / 0.0"], ["n", "240 to 432"]]]


def test_without_movers_there_are_no_such_figures() -> None:
    nothing = np.zeros(CAMERA.shape, bool)
    unseen = replace(evaluation_frames(1)[0], moving=nothing, departed_m=nothing.astype(np.float32))
    for frames in (evaluation_frames(2), [unseen]):
        metrics = {metric for metric, *_ in scores_of(TRUTH, frames, lambda depth_m: depth_m)}
        assert not metrics & {"survival", "survival_raw", "ghosts", "ghosts_raw"}


def test_an_object_that_is_back_has_not_departed() -> None:
    departures, depth_m = Departures(), np.full((1, 1), 2, np.float32)
    there = [True, *[False] * (GHOST_FRAMES - 1), True]
    assert not any(departures.add(np.full((1, 1), is_there), depth_m).any() for is_there in there)


def test_flying_fills_are_counted_among_the_fills_beside_an_edge_at_any_range() -> None:
    """The shadow beside the post is filled at 3 m; the wall lies at 6 m or, in the second case, at 30 m."""
    for wall_m in (WALL_M, 30):
        frame = evaluation_frames(1)[0]
        reference_m = np.where(frame.reference_m == WALL_M, np.float32(wall_m), frame.reference_m)
        done = scores_of(TRUTH, [replace(frame, reference_m=reference_m)], lambda d: np.where(d > 0, d, np.float32(3)))
        flying = done["flying", "holes", "all", "filled"]
        assert (flying.value, flying.n) == (1, 4 * CAMERA.height_px), "only columns whose window reaches the post"
    assert done["said", "measured", "all", "filled"].value == 1, "the confidence is scored with the depth"


def test_errors_of_fills_are_reported_by_the_range_of_the_reference_by_hand() -> None:
    """Holes at 1, 2, 4, 19, 20 and 50 m get 10 % more, that at 4 m nothing; a measured pixel does not count."""
    shape = (1, 7)
    reference_m = np.array([[1, 2, 4, 19, 20, 50, 1]], np.float32)
    given = Frame(stamp_s=0.0, gray=np.zeros(shape, np.uint8), depth_m=np.array([[0] * 6 + [1]], np.float32))
    frame = EvaluationFrame(
        frame=given, reference_m=reference_m, hidden=given.depth_m == 0, static=np.zeros(shape, bool)
    )
    filled = np.array([[1, 1, 0, 1, 1, 1, 1]], np.float32)
    done = scores_of(TRUTH, [frame], lambda _: filled * np.array([[1.1, 2.02, 0, 20.9, 22, 50, 5]], np.float32))
    found = {
        r: (done["mae", "holes", r, "filled"], done["close", "holes", r, "filled"]) for r in RANGES if r != "5-10 m"
    }
    assert {name: (mae.value, close.value, mae.n) for name, (mae, close) in found.items()} == {
        "0-2 m": (pytest.approx(0.1), 0, 1),
        "2-5 m": (pytest.approx(0.02, rel=1e-4), 1, 1),
        "10-20 m": (pytest.approx(1.9), 0, 1),
        "over 20 m": (pytest.approx(1), 0.5, 2),
    }
    assert ("mae", "holes", "5-10 m", "filled") not in done
    table = range_table(evaluation_of(result_of("s", "telea", *done.values()), result_of("s", "raw")))
    assert table.headings == ["method", *RANGES]
    assert table.texts == [
        ["s, telea", "0.100 / 0.0 (1)", "0.020 / 100.0 (1)", "-", "1.900 / 0.0 (1)", "1.000 / 50.0 (2)"]
    ]
