"""The growth of collisions with the noise of the depth."""

import numpy as np
import pytest

from scenarios.experiments import collisions
from scenarios.experiments.collisions import B_BOUNDS, _collision_ratio, _likeliest, fit_growth

THETAS = np.array([0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0])


@pytest.fixture(autouse=True)
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(collisions, "RESAMPLES", 60)


def test_the_fit_is_the_most_likely_of_a_fine_grid() -> None:
    k, n = np.array([0, 1, 1, 4, 3, 9, 14, 15]), 30

    def likelihood(a: float, b: float) -> float:
        p = 1 - np.exp(-a * THETAS**b)
        return float((k * np.log(p) + (n - k) * np.log(1 - p)).sum())

    found = _likeliest(THETAS, k, n)
    around = [(found[0] * f, found[1] + d) for f in (0.98, 1.0, 1.02) for d in (-0.05, 0.0, 0.05)]
    assert max(around, key=lambda ab: likelihood(*ab)) == found


def test_the_curve_that_made_the_runs_is_found() -> None:
    truth = np.array([[0.8, 3.0]])
    p = np.array([_collision_ratio(truth, theta)[0] for theta in THETAS])
    found = fit_growth(THETAS, np.random.default_rng(1).random((200, 8)) < p)
    assert found.exponent.interval.low < 3.0 < found.exponent.interval.high
    ratio = _collision_ratio(truth, 1.0) / _collision_ratio(truth, 0.5)
    assert found.ratio.interval.low < ratio < found.ratio.interval.high


def test_the_bootstrap_draws_seeds_and_not_runs() -> None:
    """Seeds that collide everywhere or nowhere: the shares of all thetas rise and fall together."""
    found = fit_growth(np.array([0.5, 1.0]), np.repeat(np.arange(20) < 10, 2).reshape(20, 2))
    assert found.exponent.interval == pytest.approx((0, 0), abs=1e-3)


def test_without_enough_data_there_is_no_fit_or_one_at_a_bound() -> None:
    theta = np.array([0.5, 1.0])
    assert fit_growth(theta, np.array([[False, True], [False, False]])).exponent.value == pytest.approx(B_BOUNDS[1])
    for always in (True, False):
        assert fit_growth(theta, np.full((4, 2), always)) is None
