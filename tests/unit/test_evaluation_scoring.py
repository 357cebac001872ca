"""What is scored, by hand: disjoint groups of pixels, errors, flicker, things that move, and confidence."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, product
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
    key_of,
    scores_of,
    truth_of,
    write_recording,
)
from voxdepth.geometry import fill_from_nearest
from voxdepth.metrics import RANGE_BINS_M, Sums
from voxdepth.tools.evaluation.groups import (
    BINS,
    HOLE_GROUPS,
    NONE,
    RANGES,
    TRUE_GROUPS,
    Groups,
    held_out_groups,
    split,
)
from voxdepth.tools.evaluation.measurements import Measurement
from voxdepth.tools.evaluation.quantities import QUANTITIES
from voxdepth.tools.evaluation.report import method_table
from voxdepth.tools.evaluation.result_cache import Result
from voxdepth.tools.evaluation.scoring import METRICS, SETTLED_FRAMES, CalibrationScore
from voxdepth.tools.evaluation.sources import EvaluationFrame, FrameCache
from voxdepth.types import CorrectedDepth, FloatImage, Intrinsics

PATCH_GROUPS = held_out_groups("patches")
MOVERS = "[sequence]\nmovers = [{ radius_m = 0.3 }, { radius_m = 0.3 }]\n"
"""The post has the segmentation id 1: it is the second of two movers. The first one, id 0, is the wall's."""
TELE = Intrinsics(fx_px=1000, fy_px=1000, cx_px=320, cy_px=180, width_px=640, height_px=360, baseline_m=0.1)
"""A disparity of 10 px at 10 m: there 5 % decide."""
NEAR_FILLED = ("all", "0-20 m", "filled")


def scored(change: Change, groups: Groups = TRUE_GROUPS) -> dict[tuple[str, ...], Measurement]:
    return scores_of(groups, evaluation_frames(4), change)


@pytest.mark.parametrize("groups", [TRUE_GROUPS, HOLE_GROUPS, PATCH_GROUPS])
@settings(max_examples=5)
@given(seed=st.integers(0, 2**32))
def test_the_sums_of_groups_are_those_of_each_mask_and_range(groups: Groups, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth_m = rng.choice([0.5, 2, 3, 5, 9, 10, 20, 60, np.inf], (12, 16)).astype(np.float32)
    depth_m = rng.choice([0, 1, 2, 8, 30], (12, 16)).astype(np.float32)
    kind = rng.integers(0, len(groups.kinds), (12, 16)).astype(np.uint8)
    labels = groups.label(truth_m, kind)
    parts = [
        Sums.of(depth_m.ravel()[where], truth_m.ravel()[where], np.ones(where.size, bool))
        for where in split(labels, len(groups))
    ]
    for mask, within in product(groups.masks, RANGES):
        ends_m = [RANGE_BINS_M[BINS[index]] for index in RANGES[within]]
        there = np.any([(truth_m >= low_m) & (truth_m < high_m) for low_m, high_m in ends_m], axis=0)
        of_kind = np.isin(kind, [groups.kinds.index(name) for name in groups.masks[mask]])
        expected = Sums.of(depth_m, truth_m, there & of_kind)
        added = sum((parts[member] for member in groups.members(mask, within)), Sums())
        assert (added.pixels, added.filled, added.too_far) == (expected.pixels, expected.filled, expected.too_far)
        assert added.abs_error_m == pytest.approx(expected.abs_error_m)


def test_pixels_without_a_reference_are_in_no_group() -> None:
    reference_m = np.array([[0, np.inf, 1, 25]], np.float32)
    labels = TRUE_GROUPS.label(reference_m, np.array([[0, 0, 2, 3]], np.uint8))
    assert labels.tolist() == [[NONE, NONE, 2, 4 * 4 + 3]]
    groups = split(labels, len(TRUE_GROUPS))
    assert {k: list(where) for k, where in enumerate(groups) if where.size} == {2: [2], 19: [3]}


@pytest.mark.parametrize("groups", [TRUE_GROUPS, HOLE_GROUPS, PATCH_GROUPS])
def test_every_kind_is_in_all_and_what_is_hidden_is_not_measured(groups: Groups) -> None:
    assert set(groups.masks["all"]) == set(groups.kinds)
    assert not set(groups.masks[groups.hidden]) & set(groups.masks["measured"])
    assert sorted(groups.members("all", "all")) == list(range(len(groups)))


def test_a_perfect_method_has_no_error() -> None:
    truths_m = map(truth_of, range(4))
    done = scored(lambda depth_m: next(truths_m))
    for metric in METRICS:
        assert done[metric, "all", "all", "completed"].value == (metric == "close"), metric
    assert done["m_rmse_u16_wrap", "occluded", "all", "as given"].value == 0
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
    assert done["mae", "all", "all", "filled"].value == 0 and done["mae", "all", "all", "completed"].value > 0.3
    assert done["mae", "holes", "all", "filled"].value is None and done["coverage", "holes", "all", "filled"].value == 0


def test_a_frame_given_wholly_empty_leaves_no_figure_after_completion() -> None:
    truths_m = iter([truth_of(0), 0 * truth_of(1), truth_of(2), truth_of(3)])
    done = scored(lambda depth_m: next(truths_m))
    for metric in METRICS:
        assert done[metric, "all", "0-20 m", "completed"].value is None, metric
        assert done[metric, *NEAR_FILLED].value is not None, metric
    assert done["psnr16_mm", "all", "all", "completed"].value is None


def test_a_wrong_depth_that_stays_does_not_flicker_and_one_that_changes_does() -> None:
    assert scored(lambda d: np.full_like(d, 9))["switched", "static", "0-20 m", "filled"].value == 0
    signs = cycle([1, -1])
    assert scored(lambda d: np.full_like(d, 9 + 0.5 * next(signs)))["flicker", "static", "0-20 m", "filled"].value > 0.9


def test_flicker_of_fills_leaves_out_what_was_measured_in_either_frame() -> None:
    fills_m = cycle([3, 9])
    done = scored(lambda depth_m: np.where(depth_m > 0, depth_m, np.float32(next(fills_m))))
    everywhere, filled = (done["flicker", mask, "0-20 m", "filled"] for mask in ("static", "static filled"))
    assert filled.n < everywhere.n and filled.value == pytest.approx(6, abs=1.5), "the change of the fills alone"


def test_frames_are_averaged_as_told_and_settled_errors_leave_the_warm_up_out() -> None:
    n = SETTLED_FRAMES + 2
    factors = iter([1.1, *[1] * (n - 1)])
    frames = evaluation_frames(n)
    truths_m = iter([frame.reference_m for frame in frames])
    done = scores_of(TRUE_GROUPS, frames, lambda _: next(truths_m) * np.float32(next(factors)))
    assert done["z_accuracy", "center", "all", "filled"].value == pytest.approx(0, abs=1e-6), "the median"
    assert done["m_rmse_u16_wrap", "occluded", "all", "as given"].value > 1, "the mean"
    settled, whole = (done[f"psnr16_mm{name}", "all", "all", "completed"] for name in ("_settled", ""))
    assert (settled.value, settled.n) == (np.inf, 2 * CAMERA.width_px * CAMERA.height_px)
    assert whole.value < 60 and whole.n == n * settled.n / 2


def test_without_the_truth_held_out_pixels_are_judged_and_the_change_of_depth_is_flicker() -> None:
    frame, kind = evaluation_frames(1)[0], np.zeros(CAMERA.shape, np.uint8)
    kind[:, :10] = 1
    labelled = replace(frame, labels=PATCH_GROUPS.label(frame.reference_m, kind), static=np.ones(CAMERA.shape, bool))
    changes_m, off_m = iter([0, 0.1, 0]), np.float32(0.5) * kind
    done = scores_of(PATCH_GROUPS, [labelled] * 3, lambda _: frame.reference_m + off_m + np.float32(next(changes_m)))
    flicker = [found for (metric, mask, *_), found in done.items() if (metric, mask) == ("flicker", "static")]
    assert [(found.range, found.value) for found in flicker] == [("0-20 m", pytest.approx(0.1, rel=1e-4))]
    ratio = scores_of(PATCH_GROUPS, [labelled], lambda _: frame.reference_m + off_m)
    found = ratio["psnr16_mm", "patches", "all", "completed"]
    assert (found.value, found.n) == (pytest.approx(20 * np.log10(65.535 / 0.5), rel=1e-5), kind.sum())


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
    cache = FrameCache(tmp_path)
    cache.fill(moving)
    np.testing.assert_array_equal(cache[6].moving, moving[6].moving)
    np.testing.assert_array_equal(cache[6].departed_m, moving[6].departed_m)
    cache.fill(evaluation_frames(1))
    assert (cache[0].moving, cache[0].departed_m) == (None, None)


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
    done = scores_of(TRUE_GROUPS, [frame], lambda _: remembered_m)
    for wanted, value, n in (
        (("survival", "moving", "all", "as given"), 0.8, 10),
        (("survival_raw", "moving", "all", "as given"), 0.5, 10),
        (("ghosts", "departed", "all", "filled"), 3 / 9, 9),
        (("ghosts_raw", "departed", "all", "filled"), 0.0, 5),
    ):
        assert (done[wanted].value, done[wanted].n) == (pytest.approx(value), n * CAMERA.height_px), wanted
    result = Result(key=key_of("s", "m"), measurements=tuple(done.values()))
    tables = [method_table(evaluation_of(result), q).rows for q in QUANTITIES if q.layout == "against raw"]
    assert tables == [[["m", "50.0 +30.0"], ["n", "480"]], [["m", "0.0 +33.3"], ["n", "240 to 432"]]]


def test_without_movers_there_are_no_such_figures() -> None:
    nothing = np.zeros(CAMERA.shape, bool)
    unseen = replace(evaluation_frames(1)[0], moving=nothing, departed_m=nothing.astype(np.float32))
    for frames in (evaluation_frames(2), [unseen]):
        metrics = {metric for metric, *_ in scores_of(TRUE_GROUPS, frames, lambda depth_m: depth_m)}
        assert not metrics & {"survival", "survival_raw", "ghosts", "ghosts_raw"}


def row(*values: float) -> FloatImage:
    return np.array([values], np.float32)


def calibrated(
    depth_m: FloatImage, truth_m: FloatImage, confidence: FloatImage, camera: Intrinsics = TELE, **given: np.ndarray
) -> Iterator[Measurement]:
    """What is found of one frame, whose pixels are all scored and holes unless it is said."""
    score, everywhere = CalibrationScore(camera, "holes"), np.ones(depth_m.shape, bool)
    source = given.get("source", np.zeros(depth_m.shape, np.uint8))
    corrected = CorrectedDepth(depth_m=depth_m, confidence=confidence, source=source)
    score.add(corrected, truth_m, given.get("scored", everywhere), given.get("hidden", everywhere))
    return score.measurements()


def by_mask(found: Iterator[Measurement], metric: str) -> dict[str, tuple[float | None, int]]:
    return {one.mask: (one.value, one.n) for one in found if one.metric == metric}


def test_errors_are_sorted_by_confidence_and_the_end_of_a_bin_belongs_to_it() -> None:
    truth_m = np.full((1, 9), 10, np.float32)
    depth_m = truth_m + row(0, 1, 3, 2, 0, 4, 0.4, 0.6, 9)
    found = depth_m, truth_m, row(0, 0.05, 0.1, 0.3, 0.7, 0.30001, 1, 0.95, 0.5)
    expected = {
        "confidence 0": (0, 1), "confidence 0-0.1": (2, 2), "confidence 0.2-0.3": (2, 1), "confidence 0.3-0.4": (4, 1),
        "confidence 0.4-0.5": (9, 1), "confidence 0.6-0.7": (0, 1), "confidence 0.9-1": (0.5, 2),
    }  # fmt: skip
    approximate = {mask: (pytest.approx(value, abs=1e-6), n) for mask, (value, n) in expected.items()}
    assert by_mask(calibrated(*found), "mae") == approximate
    assert by_mask(calibrated(*found), "correct")["confidence 0.9-1"] == (0.5, 2)
    short = replace(TELE, baseline_m=0.02)  # 2 px at 10 m: a quarter of a pixel decides
    assert by_mask(calibrated(*found, short), "correct")["confidence 0.9-1"] == (1, 2)


def test_errors_by_source_leave_out_what_does_not_count() -> None:
    """Not counted: a hole, a pixel that is not scored, one beyond 40 m, the sky, and a source that is none."""
    truth_m = row(10, 10, 10, 10, 10, 10, 50, np.inf, 10)
    depth_m = row(11, 12, 14, 15, 0, 19, 60, 10, 10)
    source, scored = np.array([[1, 2, 2, 3, 3, 1, 1, 2, 0]], np.uint8), row(1, 1, 1, 1, 1, 0, 1, 1, 1) > 0
    mae = by_mask(calibrated(depth_m, truth_m, 0 * depth_m, source=source, scored=scored, hidden=scored), "mae")
    of_sources = {mask: found for mask, found in mae.items() if mask.startswith("source")}
    assert of_sources == {"source sensor": (1, 1), "source memory": (3, 2), "source inpainted": (5, 1)}


def test_the_share_of_right_pixels_in_a_bin_is_also_that_of_each_source_and_of_holes() -> None:
    truth_m, confidence = np.full((1, 6), 10, np.float32), row(0.55, 0.55, 0.55, 0.95, 0.55, 0)
    source, hidden = np.array([[1, 2, 2, 2, 3, 0]], np.uint8), row(0, 1, 1, 0, 1, 1) > 0
    found = calibrated(row(10, 10, 12, 10, 12, 0), truth_m, confidence, source=source, hidden=hidden)
    assert {mask: share for mask, share in by_mask(found, "correct").items() if ", " in mask} == {
        "source sensor, confidence 0.5-0.6": (1, 1),
        "source memory, confidence 0.5-0.6": (0.5, 2),
        "source memory, confidence 0.9-1": (1, 1),
        "source inpainted, confidence 0.5-0.6": (0, 1),
        "holes, confidence 0.5-0.6": (pytest.approx(1 / 3), 3),
    }
