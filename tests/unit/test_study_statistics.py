"""Intervals, pairs and dose responses against numbers that were worked out by hand or are printed in the sources."""

import math

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study.statistics import (
    DoseCurve,
    Interval,
    Pairs,
    dose_response,
    fit_dose_curve,
    holm,
    mcnemar,
    newcombe,
    pairs_needed,
    wilson,
)

THETAS = [0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0]


def close(interval: Interval, low: float, high: float, within: float = 5e-5) -> bool:
    return abs(interval.low - low) <= within and abs(interval.high - high) <= within


def test_the_tests_and_intervals_are_those_of_the_text_books() -> None:
    assert close(wilson(30, 100), 0.219, 0.396, 5e-4)
    assert close(wilson(0, 100), 0, 1.96**2 / (100 + 1.96**2))
    tail = sum(math.comb(12, k) for k in range(3)) / 2**12
    assert [mcnemar(2, 10), mcnemar(10, 2), mcnemar(0, 0), mcnemar(5, 5)] == pytest.approx([2 * tail, 2 * tail, 1, 1])
    assert holm([0.04, 0.01, 0.03, 0.5]) == pytest.approx([0.09, 0.04, 0.09, 0.5])
    assert holm([]) == []


@pytest.mark.parametrize(("discordant", "effect"), [(0.2, 0.1), (0.5, 0.1), (0.3, 0.2)])
def test_the_pairs_that_are_needed_have_a_power_of_about_80_percent(discordant: float, effect: float) -> None:
    pairs, gained, lost = pairs_needed(discordant, effect), (discordant + effect) / 2, (discordant - effect) / 2
    drawn = np.random.default_rng(0).multinomial(pairs, [gained, lost, 1 - discordant], 1000)
    found = np.mean([mcnemar(int(b), int(c)) < 0.05 for b, c, _ in drawn])
    assert found == pytest.approx(0.8, abs=0.08)
    assert pairs_needed(0.01, effect) == pairs_needed(effect, effect), "an effect needs as many discordant pairs"


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


def test_the_fit_is_the_most_likely_of_a_fine_grid() -> None:
    k, n = np.array([0, 1, 1, 4, 3, 9, 14, 15]), 30
    theta = np.array(THETAS)

    def likelihood(a: float, b: float) -> float:
        p = 1 - np.exp(-a * theta**b)
        return float((k * np.log(p) + (n - k) * np.log(1 - p)).sum())

    curve = fit_dose_curve(THETAS, k.tolist(), [n] * 8)
    around = [(curve.a * f, curve.b + d) for f in (0.98, 1.0, 1.02) for d in (-0.05, 0.0, 0.05)]
    assert max(around, key=lambda ab: likelihood(*ab)) == (curve.a, curve.b)


def test_the_dose_response_finds_the_curve_that_made_the_runs_and_repeats_itself() -> None:
    truth = DoseCurve(a=0.8, b=3.0)
    rng = np.random.default_rng(1)
    rows = rng.random((200, 9)) < [truth.at(theta) for theta in [0.0, *THETAS]]
    found = dose_response([0.0, *THETAS], rows, resamples=60)
    assert found.a.low < 0.8 < found.a.high
    assert found.b.low < 3.0 < found.b.high
    assert found.ratio.low < truth.ratio < found.ratio.high
    assert found.seeds == 200
    assert found == dose_response([0.0, *THETAS], rows, resamples=60)


def test_the_bootstrap_draws_rows_not_cells() -> None:
    """Seeds that collide everywhere or nowhere: the shares of all thetas rise and fall together."""
    rows = np.repeat(np.arange(20) < 10, 2).reshape(20, 2)
    found = dose_response([0.5, 1.0], rows, resamples=60)
    assert found.b.low == pytest.approx(0, abs=1e-3)
    assert found.b.high == pytest.approx(0, abs=1e-3)
    assert found.a.high > 1.5 * found.a.low


def test_a_dose_response_without_enough_data_is_refused_or_marked() -> None:
    steep = dose_response([0.5, 1.0], np.array([[False, True], [False, False]]), resamples=20)
    assert steep.curve.at_bound
    for collisions in ([0, 0], [4, 4]):
        with pytest.raises(ScenarioError, match="needs runs at two noise ratios above 0"):
            fit_dose_curve([0.5, 1.0], collisions, [4, 4])
