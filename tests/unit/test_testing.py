"""The helpers that users put into their own tests."""

import numpy as np
import pytest

from sim.errors import SensorError
from sim.testing import DRONE_ID, LEVELS, TERMS, Level, Term, noisy_sequence, noisy_sequences, sensor_config
from sim.types import InvalidReason

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


def test_sequences_that_are_rendered_together_are_those_that_are_rendered_alone() -> None:
    kinds: list[tuple[Term, Level]] = [
        ("blank", "low"),
        ("occlusion", "high"),
        ("flicker", "high"),
        ("occlusion", "low"),
    ]
    together = [list(sequence) for sequence in noisy_sequences(kinds, seed=2, frames=3)]
    for kind, sequence in zip(kinds, together, strict=True):
        for a, b in zip(sequence, noisy_sequence(*kind, seed=2, frames=3), strict=True):
            for name in ("gray_left", "gray_right", "depth_raw_m", "depth_true_m", "segment_id", "invalid_reason"):
                np.testing.assert_array_equal(getattr(a, name), getattr(b, name), str(kind))
            assert a.intrinsics == b.intrinsics


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
    assert captures[0].segment_id.max() == DRONE_ID
    drone = [capture.segment_id == DRONE_ID for capture in captures]
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
