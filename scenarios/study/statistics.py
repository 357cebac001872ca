"""Shares of runs with their intervals, and pairs of runs compared. Runs are the unit; small pure functions.

Sources:
    [1] Wilson, J. Am. Stat. Assoc. 22 (1927) 209, doi:10.1080/01621459.1927.10502953.
    [2] Newcombe, Stat. Med. 17 (1998) 2635, method 10 (paired differences).
    [3] Holm, Scand. J. Stat. 6 (1979) 65.
    [4] Clopper, Pearson, Biometrika 26 (1934) 404, doi:10.1093/biomet/26.4.404.
    [5] McNemar, Psychometrika 12 (1947) 153, doi:10.1007/BF02295996; here exact, by the binomial distribution.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

LEVEL = 0.95
"""Confidence level of every interval."""


@dataclass(frozen=True)
class Interval:
    """A confidence interval."""

    low: float
    high: float


def wilson(k: int, n: int) -> Interval:
    """Wilson's score interval of a share `k / n`, n > 0: [1]."""
    return _proportion(k, n, "wilson")


def clopper_pearson(k: int, n: int) -> Interval:
    """The exact interval of a share `k / n`, n > 0, never too short, for claims about safety: [4]."""
    return _proportion(k, n, "exact")


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Two ways to fly the same runs: how many collided with both, one, or neither."""

    both: int
    first_only: int
    """b of McNemar's test."""
    second_only: int
    """c of McNemar's test."""
    neither: int

    @property
    def n(self) -> int:
        """Pairs."""
        return self.both + self.first_only + self.second_only + self.neither

    @property
    def difference(self) -> float:
        """Share of the first minus share of the second; n > 0."""
        return (self.first_only - self.second_only) / self.n


def pairs_of(outcomes: Sequence[tuple[bool, bool]]) -> Pairs:
    """Count pairs of (first collided, second collided)."""
    return Pairs(
        both=outcomes.count((True, True)),
        first_only=outcomes.count((True, False)),
        second_only=outcomes.count((False, True)),
        neither=outcomes.count((False, False)),
    )


def mcnemar(b: int, c: int) -> float:
    """Exact two-sided p-value of McNemar's test [5]: of b + c pairs that differ, b to one side; 1 if none differs."""
    from scipy.stats import binomtest

    return float(binomtest(b, b + c, 0.5).pvalue) if b + c else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """P-values adjusted for their number after Holm [3], in the order given."""
    adjusted = [0.0] * len(p_values)
    largest = 0.0
    for rank, i in enumerate(sorted(range(len(p_values)), key=lambda i: p_values[i])):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[i]))
        adjusted[i] = largest
    return adjusted


def newcombe(pairs: Pairs) -> Interval:
    """Interval of the difference of two paired shares: Newcombe's square-and-add method with correlation [2]; n > 0."""
    n, first, second = pairs.n, pairs.both + pairs.first_only, pairs.both + pairs.second_only
    phi = _correlation(pairs)
    p1, p2 = first / n, second / n
    w1, w2 = wilson(first, n), wilson(second, n)
    below = _combined(p1 - w1.low, w2.high - p2, phi)
    above = _combined(w1.high - p1, p2 - w2.low, phi)
    return Interval(pairs.difference - below, pairs.difference + above)


def percentiles(values: Sequence[float]) -> Interval:
    """The middle 95 % of at least one value."""
    import numpy as np

    tail = 50 * (1 - LEVEL)
    low, high = np.percentile(np.asarray(values, np.float64), [tail, 100 - tail])
    return Interval(float(low), float(high))


def _proportion(k: int, n: int, method: str) -> Interval:
    from scipy.stats import binomtest

    found = binomtest(k, n).proportion_ci(LEVEL, method=method)
    return Interval(float(found.low), float(found.high))


def _correlation(pairs: Pairs) -> float:
    """Of the two outcomes, corrected for continuity; 0 if one of them never varies."""
    e, f, g, h = pairs.both, pairs.first_only, pairs.second_only, pairs.neither
    spread = (e + f) * (g + h) * (e + g) * (f + h)
    if spread == 0:
        return 0.0
    product: float = e * h - f * g
    if product > 0:
        product = max(0.0, product - pairs.n / 2)
    return product / math.sqrt(spread)


def _combined(a: float, b: float, phi: float) -> float:
    return math.sqrt(max(0.0, a * a - 2 * phi * a * b + b * b))
