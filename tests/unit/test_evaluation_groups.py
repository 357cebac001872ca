"""Groups of pixels: disjoint, and adding up to every mask and range."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.evaluation_clips import CAMERA, evaluation_frames
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
from voxdepth.tools.evaluation.scoring import METRICS, Score
from voxdepth.types import CorrectedDepth

PATCH_GROUPS = held_out_groups("patches")


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
    labels = TRUE_GROUPS.label(reference_m, np.array([[0, 0, 3, 5]], np.uint8))
    assert labels.tolist() == [[NONE, NONE, 3, 4 * 6 + 5]]
    groups = split(labels, len(TRUE_GROUPS))
    assert {k: list(where) for k, where in enumerate(groups) if where.size} == {3: [2], 29: [3]}


@pytest.mark.parametrize("groups", [TRUE_GROUPS, HOLE_GROUPS, PATCH_GROUPS])
def test_every_kind_is_in_all_and_what_is_hidden_is_not_measured(groups: Groups) -> None:
    assert set(groups.masks["all"]) == set(groups.kinds)
    assert not set(groups.masks[groups.hidden]) & set(groups.masks["measured"])
    assert sorted(groups.members("all", "all")) == list(range(len(groups)))


def measurement(score: Score, *wanted: str) -> Measurement:
    (found,) = (f for f in score.measurements() if (f.metric, f.mask, f.range, f.on) == wanted)
    return found


def test_a_frame_given_wholly_empty_leaves_no_figure_after_completion() -> None:
    score = Score(TRUE_GROUPS, CAMERA)
    for index, frame in enumerate(evaluation_frames(3)):
        score.add(frame, CorrectedDepth.of(frame.frame, frame.reference_m * np.float32(index != 1)))
    for metric in METRICS:
        assert measurement(score, metric, "all", "0-20 m", "completed").value is None, metric
        assert measurement(score, metric, "all", "0-20 m", "filled").value is not None, metric
    assert measurement(score, "psnr16_mm", "all", "all", "completed").value is None


def test_without_the_truth_the_ratio_in_16_bits_is_of_held_out_pixels() -> None:
    frame = evaluation_frames(1)[0]
    kind = np.zeros(CAMERA.shape, np.uint8)
    kind[:, :10] = 1
    depth_m = frame.reference_m + np.float32(0.5) * kind
    score = Score(PATCH_GROUPS, CAMERA)
    labelled = replace(frame, labels=PATCH_GROUPS.label(frame.reference_m, kind))
    score.add(labelled, CorrectedDepth.of(frame.frame, depth_m))
    ratio = measurement(score, "psnr16_mm", "patches", "all", "completed")
    assert ratio.value == pytest.approx(20 * np.log10(65.535 / 0.5), rel=1e-5)
    assert ratio.n == kind.sum()
