"""The helpers that users put into their own tests."""

from pathlib import Path

import numpy as np
import pytest

from sim.errors import SensorError
from sim.testing import LEVELS, TERMS, Level, Term, noisy_sequence, sensor_config
from sim.types import InvalidReason
from voxdepth.testing import assert_depth_close

DEPTH = np.full((20, 30), 4.0, np.float32)

ALLOWED = {
    "occlusion": {InvalidReason.OCCLUDED},
    "flicker": {InvalidReason.FLICKER},
    "blank": {InvalidReason.TEXTURELESS},
}
"""Reasons for holes that a noise term may give."""


def test_a_sequence_is_the_same_for_the_same_arguments_and_another_for_another_seed() -> None:
    one, same = (list(noisy_sequence("flicker", "high", seed=2, frames=4)) for _ in range(2))
    (other,) = noisy_sequence("flicker", "high", seed=3, frames=1)
    for a, b in zip(one, same, strict=True):
        for name in ("gray_left", "gray_right", "depth_raw_m", "depth_true_m", "segment_id"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert not np.array_equal(one[0].gray_left, other.gray_left)
    assert one[0].depth_raw_m.shape == (120, 160)
    assert [round(capture.stamp_s * 30) for capture in one] == [0, 1, 2, 3]


@pytest.mark.parametrize("term", TERMS)
def test_each_term_acts_alone_and_grows_with_its_level(term: Term) -> None:
    harm = []
    for level in LEVELS:
        (capture,) = noisy_sequence(term, level, frames=1)
        true_m = np.minimum(capture.depth_true_m, 40)
        wrong = np.abs(capture.depth_raw_m - true_m) > 1e-4
        lost = capture.depth_raw_m == 0
        harm.append(np.abs(capture.depth_raw_m - true_m).mean())
        allowed = ALLOWED.get(term, set())
        assert set(np.unique(capture.invalid_reason)) <= {InvalidReason.NONE, *allowed}
        assert lost.any() == bool(allowed)
        if term in ("occlusion", "blank"):
            np.testing.assert_array_equal(wrong, lost)
    assert 0 < harm[0] < harm[1] < harm[2]


def test_something_moves_through_the_view() -> None:
    captures = list(noisy_sequence("scale", "low"))
    drone = [capture.segment_id == captures[0].segment_id.max() for capture in captures]
    columns = [np.nonzero(seen)[1].mean() for seen in drone if seen.any()]
    assert len(columns) > 15
    assert abs(columns[-1] - columns[0]) > 20


@pytest.mark.parametrize(("term", "level"), [("fog", "low"), ("scale", "extreme")])
def test_unknown_terms_and_levels_are_refused_with_the_choice(term: Term, level: Level) -> None:
    with pytest.raises(SensorError, match=r"choose a term of occlusion, scale, .* and a level of low, medium, high"):
        noisy_sequence(term, level)
    with pytest.raises(SensorError):
        sensor_config(term, level)


@pytest.mark.parametrize("frames", [-1, 0, 301])
def test_sequences_of_other_lengths_than_the_walk_are_refused(frames: int) -> None:
    with pytest.raises(SensorError, match="has 1 to 300 frames"):
        noisy_sequence("scale", "low", frames=frames)


def test_depth_that_is_close_passes() -> None:
    assert_depth_close(DEPTH, DEPTH, mae_m=0, too_far_share=0, hole_share=0)
    with_sky = np.where(np.arange(30) < 5, np.inf, DEPTH).astype(np.float32)
    assert_depth_close(DEPTH, with_sky, mae_m=0, hole_share=0)


@pytest.mark.parametrize(
    ("depth", "limits", "message"),
    [
        (DEPTH + 0.5, {"mae_m": 0.1}, r"FAIL mean absolute error: 0.5 m, at most 0.1 m"),
        (DEPTH * 1.2, {"too_far_share": 0.1}, r"FAIL share more than 10% too far: 1, at most 0.1"),
        (DEPTH * 0, {"mae_m": 1.0}, r"FAIL mean absolute error: none, nothing has depth"),
        (DEPTH * (np.arange(30) < 15), {"hole_share": 0.4}, r"FAIL share of holes: 0.5, at most 0.4"),
    ],
)
def test_depth_that_is_not_close_fails_with_all_figures(depth: np.ndarray, limits: dict, message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        assert_depth_close(depth.astype(np.float32), DEPTH, **limits)


def test_a_failure_is_shown_at_the_line_of_the_test() -> None:
    with pytest.raises(AssertionError) as failed:
        assert_depth_close(np.zeros((2, 2), np.float32), np.ones((2, 2), np.float32), hole_share=0.5)
    shown = [entry for entry in failed.traceback if not entry.ishidden(failed)]
    assert [Path(entry.path).name for entry in shown] == [Path(__file__).name]


def test_comparing_nothing_is_a_failure() -> None:
    with pytest.raises(AssertionError, match="nothing to compare"):
        assert_depth_close(DEPTH, DEPTH, max_range_m=2.0)
    with pytest.raises(AssertionError, match="nothing to compare"):
        assert_depth_close(DEPTH, np.full_like(DEPTH, np.inf))
    with pytest.raises(AssertionError, match="shape"):
        assert_depth_close(DEPTH, DEPTH[:5])
