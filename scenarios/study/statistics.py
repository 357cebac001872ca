"""Statistics of runs: intervals of proportions, paired comparisons, and curves over the difficulty of flights.

The unit of analysis is the run. All functions are pure. What SciPy and statsmodels have is theirs.

Sources:
    [1] Wilson, J. Am. Stat. Assoc. 22 (1927) 209, doi:10.1080/01621459.1927.10502953.
    [2] Newcombe, Stat. Med. 17 (1998) 2635, method 10 (paired differences).
    [3] Holm, Scand. J. Stat. 6 (1979) 65.
    [4] McNemar, Psychometrika 12 (1947) 153, doi:10.1007/BF02295996; here exact, by the binomial distribution.
    [5] Rao, Wu, J. Am. Stat. Assoc. 83 (1988) 231, doi:10.1080/01621459.1988.10478591: the bootstrap of small strata.
    [6] Wichmann, Hill, Percept. Psychophys. 63 (2001) 1293, doi:10.3758/BF03194544: psychometric curves with lapses.
    [7] Barlow, Brunk, J. Am. Stat. Assoc. 67 (1972) 140, doi:10.2307/2284712: means that fall, by least squares.
    [8] McCullagh, Nelder, Generalized Linear Models (1989), section 4.3: links of binary data.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from voxdepth.tools.results.interval import LEVEL, Interval
from voxdepth.types import FloatArray, MaskImage

IndexArray = npt.NDArray[np.intp]
SeedStatistic = Callable[[IndexArray], FloatArray]
"""A statistic of seeds: it takes their numbers, shape (samples, n), and gives a value for each sample."""
RESAMPLES = 1000
BOOTSTRAP_SEED = 20240601
LAPSE = 0.02
"""Share of flights that fail however easy they are."""
LEAST_SEEDS = 6
"""Of fewer seeds, all have the same sign by chance in more than 5 % of cases, which a percentile interval takes for a
difference."""
N_POSITIONS, WIDTHS = 61, tuple(np.geomspace(0.01, 0.5, 12))
"""Number of positions along an axis at which a curve may fall to a half, and its widths as shares of the axis."""

EXPONENTS, LOG_A = np.linspace(0, 12, 121), np.linspace(-8, 4, 61)
"""The curves of a share that grows as a power, by its exponent and the logarithm of its factor."""


class Pairs(NamedTuple):
    """Counts of matched pairs of runs, by which of the two reached an endpoint, such as a collision."""

    both: int
    first_only: int
    """b of McNemar's test."""
    second_only: int
    """c of McNemar's test."""
    neither: int

    @classmethod
    def counted(cls, first: MaskImage, second: MaskImage) -> Self:
        """Count pairs by whether the run of the first and that of the second reached an endpoint, shape (n,) each."""
        kinds = first & second, first & ~second, ~first & second, ~first & ~second
        return cls(*(int(np.count_nonzero(kind)) for kind in kinds))

    @property
    def n(self) -> int:
        """Number of pairs."""
        return sum(self)

    @property
    def difference(self) -> Interval:
        """Share of runs of the first that reached the endpoint minus that of the second, by Newcombe; n > 0."""
        return newcombe(self)


def wilson(k: int, n: int) -> Interval:
    """Return a proportion `k / n` with Wilson's score interval [1]; n > 0."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(k, n, 1 - LEVEL, method="wilson")
    return Interval(k / n, float(low), float(high))


def mcnemar(b: int, c: int) -> float:
    """Return the exact two-sided p-value of McNemar's test [4] for b and c discordant pairs; 1 if there are none."""
    from statsmodels.stats.contingency_tables import mcnemar as test

    return float(test([[0, b], [c, 0]], exact=True).pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values for multiple comparisons after Holm [3], in the given order."""
    from statsmodels.stats.multitest import multipletests

    return multipletests(p_values, method="holm")[1].tolist() if p_values else []


def newcombe(pairs: Pairs) -> Interval:
    """Return the difference of two paired proportions with Newcombe's interval, method 10 [2]; n > 0."""
    n, first, second = pairs.n, pairs.both + pairs.first_only, pairs.both + pairs.second_only
    # The phi coefficient with continuity correction; 0 if one of the outcomes is constant.
    spread = first * (n - first) * second * (n - second)
    product: float = pairs.both * pairs.neither - pairs.first_only * pairs.second_only
    if product > 0:
        product = max(0.0, product - n / 2)
    phi = product / math.sqrt(spread) if spread else 0.0

    def combined(a: float, b: float) -> float:
        return math.sqrt(max(0.0, a * a - 2 * phi * a * b + b * b))

    one, other = wilson(first, n), wilson(second, n)
    difference = (pairs.first_only - pairs.second_only) / n
    below = combined(one.value - one.low, other.high - other.value)
    above = combined(one.high - one.value, other.value - other.low)
    return Interval(difference, difference - below, difference + above)


def drawn(rng: np.random.Generator, n: int) -> IndexArray:
    """Return the numbers of what a bootstrap draws of n, shape (samples, n - 1), or (samples, 1) of one.

    One less than n are drawn, because n would vary too little where n is small [5].
    """
    return rng.integers(0, n, (RESAMPLES, max(n - 1, 1)))


def percentile_interval(value: float, samples: FloatArray) -> Interval:
    """Return a value with the percentile interval of a bootstrap's samples, without those that are NaN.

    Where all samples are equal they tell nothing of the spread, as of a share of 0, and the ends are NaN.
    """
    tail = 50 * (1 - LEVEL)
    low, high = np.nanpercentile(samples, [tail, 100 - tail]).tolist()
    return Interval(float(value), low, high) if low < high else Interval(float(value), math.nan, math.nan)


def bootstrap_ratio(strata: Sequence[FloatArray]) -> Interval:
    """Return a ratio of sums with the percentile interval of a bootstrap that draws within each stratum.

    A row of a stratum, none of which is empty, is a run: what is counted, and what it is counted per, which is 1 for a
    mean. The row of a pair of runs has both numbers of the first and then those of the second, and the result is the
    difference of the ratios.
    """
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    sums = np.zeros((RESAMPLES, strata[0].shape[1]))
    for rows in strata:
        sums += len(rows) * rows[drawn(rng, len(rows))].mean(axis=1)
    value = _ratio(np.sum([rows.sum(axis=0) for rows in strata], axis=0))
    return percentile_interval(float(value), _ratio(sums))


def _ratio(sums: FloatArray) -> FloatArray:
    """Return the ratio, or the difference of two ratios, of sums of shape (..., 2) or (..., 4); 0 per 0 is 0."""
    ratios = sums[..., ::2] / np.maximum(sums[..., 1::2], 1e-12)
    return np.asarray(ratios[..., 0] if ratios.shape[-1] == 1 else ratios[..., 0] - ratios[..., 1])


def level_text(estimate: Interval, levels: FloatArray) -> str:
    """Return a level of an axis as text, or that it may be beyond the levels that were flown: none is extrapolated."""
    if is_beyond(estimate, levels):
        return f"may lie outside of {levels[0]:g} to {levels[-1]:g}"
    return estimate.text(".2f")


def is_beyond(estimate: Interval, levels: FloatArray) -> bool:
    """Return whether a level may lie beyond the ends of an axis, which stand for what is there."""
    known = [end for end in estimate if not math.isnan(end)]
    return bool(min(known) <= min(levels) or max(known) >= max(levels))


def success_threshold(levels: FloatArray, arrived: MaskImage) -> Interval:
    """Return the level at which half of the flights succeed, by maximum likelihood, with a bootstrap over seeds.

    The curves over the axis are logistic and fall, with a small share of lapses [6]. `arrived` has shape (seeds,
    levels), and the levels begin with the easiest. An end of the axis in the interval stands for all that is beyond it.
    """
    grid = np.meshgrid(np.linspace(levels[0], levels[-1], N_POSITIONS), WIDTHS, indexing="ij")
    positions, scale = (side.ravel() for side in grid)
    beyond = (levels[:, None] - positions) / (scale * (levels[-1] - levels[0]))
    success = (1 - LAPSE) / (1 + np.exp(np.clip(beyond, -50, 50)))  # of each curve at each level

    def likeliest(rows: IndexArray) -> FloatArray:
        successes = arrived[rows].sum(axis=-2, dtype=np.float64)
        log_likelihood = successes @ np.log(success) + (rows.shape[-1] - successes) @ np.log1p(-success)
        return np.asarray(positions[log_likelihood.argmax(axis=-1)])

    return over_seeds(len(arrived), likeliest)


def cloglog_curve(levels: FloatArray, reached: MaskImage) -> tuple[Interval, Interval]:
    """Return the exponent b of `p = 1 - exp(-a level^b)`, and p at level 1 over p at level 0.5, by maximum likelihood.

    This is the complementary log-log model `log(-log(1 - p)) = log a + b log level` [8]. `reached` has shape (seeds,
    levels), and the levels are above 0. A bootstrap draws seeds; samples in which no run or every run reached the
    endpoint, which fit any curve, do not count, and all is NaN where these runs are such a sample.
    """
    exponents, log_a = (side.ravel() for side in np.meshgrid(EXPONENTS, LOG_A, indexing="ij"))
    failure = -np.exp(log_a + exponents * np.log(levels)[:, None])  # logarithm of 1 - p of each curve at each level
    log_p, grown = np.log(-np.expm1(failure)), np.expm1(-np.exp(log_a)) / np.expm1(-np.exp(log_a) * 0.5**exponents)
    samples = reached[drawn(np.random.default_rng(BOOTSTRAP_SEED), len(reached))]
    shares = np.concatenate([reached[None].mean(axis=1), samples.mean(axis=1)])
    counts, inverse = np.unique(shares, axis=0, return_inverse=True)
    best = np.array([np.argmax(p @ log_p + (1 - p) @ failure) for p in counts])[inverse.ravel()]
    tells = (shares.sum(axis=1) > 0) & (shares.sum(axis=1) < len(levels))
    if not tells[0]:
        return (Interval(math.nan, math.nan, math.nan),) * 2
    exponent, growth = (
        percentile_interval(values[0], values[1:])
        for values in (np.where(tells, of[best], np.nan) for of in (exponents, grown))
    )
    return exponent, growth


def crossing(levels: FloatArray, values: FloatArray, height: float) -> float:
    """Return the level at which means that fall along the axis have come down to a height; an end for beyond it.

    The means, shape (L,), are made to fall by least squares [7], and joined by straight lines.
    """
    from scipy.optimize import isotonic_regression

    falling = isotonic_regression(values, increasing=False).x
    return float(np.interp(-height, -falling, levels))


def over_seeds(n: int, statistic: SeedStatistic) -> Interval:
    """Return a statistic of n seeds with the percentile interval of a bootstrap over them."""
    (value,) = statistic(np.arange(n)[None])
    return percentile_interval(float(value), statistic(drawn(np.random.default_rng(BOOTSTRAP_SEED), n)))
