"""The search for the difficulty at which half of the flights arrive."""

import numpy as np
import pytest

from scenarios.study.design import Axis
from scenarios.study.statistics import LAPSE, Estimate, Interval
from scenarios.threshold import AXES, ThresholdSearch, found

STOPS = AXES["light"]


def searched(axis: Axis, threshold: float, seed: int, flights: int = 25) -> Estimate:
    """What is known after some flights, of which half arrive at the threshold."""
    known, rng = ThresholdSearch(axis), np.random.default_rng(seed)
    width = 0.05 * (axis.levels[-1] - axis.levels[0])
    for _ in range(flights):
        level = known.next_level()
        arrives = (1 - LAPSE) / (1 + np.exp((known.levels[level] - threshold) / width))
        known.add(level, success=bool(rng.random() < arrives))
    return known.estimate()


@pytest.mark.parametrize(("name", "threshold"), [("light", -1.5), ("light", -4.0), ("noise", 0.8)])
def test_the_interval_covers_the_threshold_and_is_short(name: str, threshold: float) -> None:
    axis = AXES[name]
    estimates = [searched(axis, threshold, seed) for seed in range(40)]
    covered = [low <= threshold <= high for _, (low, high) in estimates]
    assert np.mean(covered) > 0.85
    widths = [abs(high - low) for _, (low, high) in estimates]
    assert np.median(widths) < 0.35 * abs(axis.levels[-1] - axis.levels[0])


def test_more_flights_know_more() -> None:
    few, many = (
        np.median([np.ptp(searched(STOPS, -2.5, seed, flights).interval) for seed in range(20)]) for flights in (10, 60)
    )
    assert many < 0.6 * few


@pytest.mark.parametrize("always", [True, False])
def test_a_threshold_outside_of_the_range_is_said_to_be_there(always: bool) -> None:
    known = ThresholdSearch(STOPS)
    for _ in range(25):
        known.add(known.next_level(), success=always)
    assert found(STOPS, known.estimate()) == ("f-stops at which half of the flights arrive: may lie outside of 0 to -6")


def test_a_threshold_is_told_with_its_interval() -> None:
    text = found(STOPS, Estimate(-1.6, Interval(-1.9, -1.2)))
    assert text == "f-stops at which half of the flights arrive: -1.60 [-1.90, -1.20]"
