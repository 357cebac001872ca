"""Intervals of the share of close pixels over the frames of a sequence and the tiles of its images."""

import numpy as np
import pytest

from voxdepth.tools.evaluation.bootstrap import Counts, drawn_shares, interval_of
from voxdepth.tools.evaluation.tiles import MIN_TILES, TILES
from voxdepth.tools.results.interval import Interval


def counts(shares: np.ndarray, evaluated: int = 100) -> Counts:
    """Shares by frame and tile, as counts of the same number of pixels each."""
    return Counts(np.rint(evaluated * shares), np.full(shares.shape, float(evaluated)))


def of_shares(shares: np.ndarray) -> Interval:
    return interval_of(drawn_shares({"m": counts(shares)})["m"])


def half_width(interval: Interval) -> float:
    return (interval.high - interval.low) / 2


def test_one_frame_has_an_interval_about_as_wide_as_that_of_the_mean_of_its_tiles() -> None:
    of_tiles = np.random.default_rng(0).integers(20, 81, (1, TILES)) / 100
    found = of_shares(of_tiles)
    assert found.value == pytest.approx(of_tiles.mean())
    assert half_width(found) == pytest.approx(1.96 * of_tiles.std() / TILES**0.5, rel=0.1)
    assert found.low < found.value < found.high


@pytest.mark.parametrize("frames", [2, 30, 300])
def test_a_camera_at_rest_that_repeats_a_frame_knows_no_more_than_one_frame(frames: int) -> None:
    of_tiles = np.random.default_rng(0).integers(20, 81, (1, TILES)) / 100
    once, often = of_shares(of_tiles), of_shares(of_tiles.repeat(frames, axis=0))
    assert half_width(often) == pytest.approx(half_width(once), rel=0.05)


def test_frames_that_differ_as_a_whole_widen_the_interval_as_tiles_do() -> None:
    of_frames = np.random.default_rng(0).integers(20, 81, (40, 1)) / 100
    assert half_width(of_shares(of_frames.repeat(TILES, axis=1))) == pytest.approx(
        1.96 * of_frames.std() / 40**0.5, rel=0.1
    )


def test_the_interval_covers_the_truth_where_places_differ_and_one_over_frames_would_not() -> None:
    """Of 60 cameras at rest with random positions, about 95 % have an interval around the mean of all places."""
    rng = np.random.default_rng(0)
    found = [of_shares(rng.uniform(0, 1, (1, TILES)) + rng.normal(0, 0.01, (20, TILES))) for _ in range(60)]
    covered = np.mean([one.low < 0.5 < one.high for one in found])
    assert 0.85 <= covered <= 1


def test_methods_are_drawn_together_so_that_a_lead_is_one_of_pairs() -> None:
    shares = np.random.default_rng(0).integers(20, 81, (5, TILES)) / 100
    draws = drawn_shares({"a": counts(shares), "b": counts(shares + 0.1)})
    assert interval_of(draws["b"] - draws["a"]) == pytest.approx((0.1, 0.1, 0.1))
    assert half_width(interval_of(draws["a"])) > 0.05


def test_few_places_have_no_interval_and_places_without_pixels_do_not_count() -> None:
    for tiles, is_known in ((MIN_TILES - 1, False), (MIN_TILES, True)):
        evaluated = np.zeros((3, TILES))
        evaluated[1, :tiles] = 10
        found = interval_of(drawn_shares({"m": Counts(evaluated / 2, evaluated)})["m"])
        assert (found.value, found.is_known, found.is_positive) == (0.5, is_known, is_known)
    nothing = Counts(np.zeros((3, TILES)), np.zeros((3, TILES)))
    assert drawn_shares({"m": nothing}).columns.empty
    assert drawn_shares({}).columns.empty
