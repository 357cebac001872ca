"""Intervals and pairs against numbers that were worked out by hand or are printed in the sources."""

import math

import numpy as np
import pytest

from scenarios.study.statistics import Pairs, bootstrap_ratio, drawn, holm, mcnemar, newcombe, over_seeds, wilson
from voxdepth.tools.results.interval import Interval
from voxdepth.types import FloatArray


def close(interval: Interval, low: float, high: float, within: float = 5e-5) -> bool:
    return abs(interval.low - low) <= within and abs(interval.high - high) <= within


def test_the_tests_and_intervals_are_those_of_the_text_books() -> None:
    assert close(wilson(30, 100), 0.219, 0.396, 5e-4)
    assert close(wilson(0, 100), 0, 1.96**2 / (100 + 1.96**2))
    tail = sum(math.comb(12, k) for k in range(3)) / 2**12
    assert [mcnemar(2, 10), mcnemar(10, 2), mcnemar(0, 0), mcnemar(5, 5)] == pytest.approx([2 * tail, 2 * tail, 1, 1])
    assert holm([0.04, 0.01, 0.03, 0.5]) == pytest.approx([0.09, 0.04, 0.09, 0.5])
    assert holm([]) == []


def test_newcombe_as_printed_in_his_paper() -> None:
    """Table of the methods compared, method 10, for 20, 12, 2 and 16 pairs."""
    assert close(newcombe(Pairs(both=20, first_only=12, second_only=2, neither=16)), 0.0562, 0.3292)


def test_newcombe_changes_sign_with_the_order_and_holds_without_variation() -> None:
    there = newcombe(Pairs(both=5, first_only=7, second_only=1, neither=9))
    back = newcombe(Pairs(both=5, first_only=1, second_only=7, neither=9))
    assert close(back, -there.high, -there.low, 1e-12)
    nothing = newcombe(Pairs(both=0, first_only=0, second_only=0, neither=16))
    assert nothing.low == pytest.approx(-wilson(0, 16).high)
    assert nothing.high == pytest.approx(wilson(0, 16).high)


def test_the_bootstrap_of_a_mean_covers_it_and_draws_within_strata() -> None:
    values = np.random.default_rng(1).normal(3.0, 1.0, 100)
    found = bootstrap_ratio([np.column_stack([values, np.ones(100)])])
    assert found.value == pytest.approx(np.mean(values))
    half = 1.96 * np.std(values) / 10
    assert found == pytest.approx((found.value, found.value - half, found.value + half), abs=0.05)
    kept = bootstrap_ratio([np.array([[0.0, 1.0]] * 5), np.ones((5, 2))])
    assert (kept.value, kept.is_known) == (0.5, False), "each keeps its share"
    pairs = [np.array([(mean - 1.0, 1.0), (mean + 1.0, 1.0)]) for mean in range(100)]
    half = 1.96 * np.sqrt(2) / np.sqrt(200)  # The standard deviation of two values that differ by 2 is sqrt(2).
    assert bootstrap_ratio(pairs)[1:] == pytest.approx((49.5 - half, 49.5 + half), abs=0.02)


@pytest.mark.parametrize("rows", [np.array([[0.0, 1.0]] * 10), np.array([[0.0, 0.3], [0.0, 9.0]]), np.ones((1, 2))])
def test_what_never_or_always_happened_or_a_single_run_tells_no_spread(rows: FloatArray) -> None:
    found = bootstrap_ratio([rows])
    assert not found.is_known and found.text(".1f") == f"{rows[0, 0]:.1f}"


def test_a_bootstrap_over_seeds_draws_one_less_and_tells_nothing_of_a_single_one() -> None:
    values = np.random.default_rng(2).normal(3.0, 1.0, 5)
    found = over_seeds(5, lambda rows: values[rows].mean(axis=-1))
    half = 1.96 * np.std(values, ddof=1) / math.sqrt(5)
    assert found == pytest.approx((values.mean(), values.mean() - half, values.mean() + half), abs=0.15)
    assert not over_seeds(1, lambda rows: values[rows].mean(axis=-1)).is_known
    assert drawn(np.random.default_rng(0), 5).shape[1] == 4


def test_a_ratio_is_that_of_the_sums_and_of_a_pair_the_difference() -> None:
    """One hit on a short way weighs no more than one on a long way."""
    first, second = np.array([(1.0, 0.1), (0.0, 0.9)]), np.array([(0.0, 0.4), (1.0, 0.1)])
    assert bootstrap_ratio([first]).value == pytest.approx(1.0)
    assert bootstrap_ratio([np.hstack([first, second])]).value == pytest.approx(1.0 - 2.0)
    assert bootstrap_ratio([np.zeros((1, 2))]).value == 0
