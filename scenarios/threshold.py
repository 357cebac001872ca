"""The difficulty at which half of the flights arrive, found with few flights that are placed where they tell most."""

from collections.abc import Iterator

import numpy as np

from .batch import fly_all
from .config import load_run
from .study.design import NOISE_RATIO, Axis
from .study.statistics import LEVEL, Estimate, Interval, LogisticCurves, told

WIDTHS = (0.02, 0.06, 0.15)
"""Scales of the logistic curve that are considered, as shares of the axis."""
FIRST_SEED = 2000
"""First seed of the flights; seeds of pilots, which no study uses."""
N_LEVELS = 61
AXES = {
    "light": Axis(key="rig.light_stops", unit="f-stops", levels=tuple(np.linspace(0, -6, N_LEVELS).tolist())),
    "noise": Axis(key=NOISE_RATIO, unit="noise ratio", levels=tuple(np.linspace(0, 1, N_LEVELS).tolist())),
}


class ThresholdSearch:
    """Estimates where a curve of successes falls to a half, by the method QUEST+ [1]_.

    The curve is logistic. Its threshold and its width have a flat prior on a grid, and the next level is the one of
    which the outcome is expected to tell most about them.

    References:
        .. [1] Watson 2017, QUEST+: a general multidimensional Bayesian adaptive psychometric method, J. Vision 17(3):10
    """

    def __init__(self, axis: Axis) -> None:
        self.levels = np.array(axis.levels)
        curves = LogisticCurves(self.levels, WIDTHS)
        self._success, self._places = curves.success, curves.places
        self._curves = np.full(self._places.size, 1 / self._places.size)
        """Probability of each curve."""

    def next_level(self) -> int:
        """Return the number of the level with the least expected entropy of the curves."""
        expected = np.zeros(N_LEVELS)
        for outcome in (self._success, 1 - self._success):
            joint = outcome * self._curves
            probability = joint.sum(axis=1)
            after = joint / probability[:, None]
            expected -= probability * (after * np.log(np.maximum(after, 1e-300))).sum(axis=1)
        return int(expected.argmin())

    def add(self, level: int, *, success: bool) -> None:
        """Add the outcome of a flight at a level."""
        likelihood = self._success[level] if success else 1 - self._success[level]
        self._curves = self._curves * likelihood / (self._curves @ likelihood)

    def estimate(self) -> Estimate:
        """Return the median of the threshold with its interval, in the unit of the axis."""
        cumulative, tail = np.cumsum(self._curves), (1 - LEVEL) / 2
        low, middle, high = (float(self._places[int(np.searchsorted(cumulative, q))]) for q in (tail, 0.5, 1 - tail))
        return Estimate(middle, Interval(*sorted((low, high))))


def found(axis: Axis, estimate: Estimate) -> str:
    """Say where half of the flights arrive, or that it is outside of the range that was flown."""
    return f"{axis.unit} at which half of the flights arrive: {told(estimate, np.array(axis.levels))}"


def search(
    axis: Axis, scenario: str, corrector: str, *, flights: int, workers: int
) -> Iterator[tuple[int, float, bool, Estimate]]:
    """Fly one drone again and again at the level that tells most, and yield each flight and what is known after it.

    Yields:
        The seed, the level, whether the drone arrived without a collision, and the estimate of the threshold.
    """
    known = ThresholdSearch(axis)
    for first in range(FIRST_SEED, FIRST_SEED + flights, workers):
        seeds, level = range(first, min(first + workers, FIRST_SEED + flights)), known.next_level()
        sensor = "noisy" if axis.key == NOISE_RATIO else "stereo"
        changes = {"mission.drones": 1, "rig.depth": sensor, "corrector": corrector}
        changes[axis.key] = axis.levels[level]
        runs = [load_run(scenario, seed, changes) for seed in seeds]
        for seed, finished in zip(seeds, fly_all(runs, workers=workers), strict=True):
            success = finished.result.outcome == "success"
            known.add(level, success=success)
            yield seed, axis.levels[level], success, known.estimate()
