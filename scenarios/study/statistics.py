"""Statistics of runs: intervals of proportions, paired comparisons, and curves over the difficulty of flights.

The unit of analysis is the run. All functions are pure. What SciPy and statsmodels have is theirs.

Sources:
    [1] Wilson, J. Am. Stat. Assoc. 22 (1927) 209, doi:10.1080/01621459.1927.10502953.
    [2] Newcombe, Stat. Med. 17 (1998) 2635, method 10 (paired differences).
    [3] Holm, Scand. J. Stat. 6 (1979) 65.
    [4] McNemar, Psychometrika 12 (1947) 153, doi:10.1007/BF02295996; here exact, by the binomial distribution.
    [5] McCullagh, Nelder, Generalized Linear Models (1989), Section 4.3: the complementary log-log link.
    [6] Rao, Wu, J. Am. Stat. Assoc. 83 (1988) 231, doi:10.1080/01621459.1988.10478591: the bootstrap of small strata.
    [7] Miettinen, Biometrics 24 (1968) 339, doi:10.2307/2528039: the number of pairs that a test needs.
    [8] Wichmann, Hill, Percept. Psychophys. 63 (2001) 1293, doi:10.3758/BF03194544: psychometric curves with lapses.
    [9] Barlow, Brunk, J. Am. Stat. Assoc. 67 (1972) 140, doi:10.2307/2284712: means that fall, by least squares.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, MaskImage

from ..errors import ScenarioError

IndexArray = npt.NDArray[np.intp]
SeedStatistic = Callable[[IndexArray], FloatArray]
"""A statistic of seeds: it takes their numbers, shape (samples, n), and gives a value for each sample."""
LEVEL = 0.95
"""Confidence level of every interval."""
RESAMPLES = 1000
BOOTSTRAP_SEED = 20240601
LAPSE = 0.02
"""Share of flights that fail however easy they are."""
N_PLACES = 61
LOG_A_BOUNDS, B_BOUNDS = (-15.0, 5.0), (0.0, 12.0)
"""Bounds of the fit. The likelihood may grow with b without limit; then the fit ends at a bound and reports it."""


class Interval(NamedTuple):
    """A confidence interval."""

    low: float
    high: float


def wilson(k: int, n: int) -> Interval:
    """Return Wilson's score interval of a proportion `k / n` with n > 0 [1]."""
    from statsmodels.stats.proportion import proportion_confint

    low, high = proportion_confint(k, n, 1 - LEVEL, method="wilson")
    return Interval(float(low), float(high))


class Estimate(NamedTuple):
    """A value with its confidence interval."""

    value: float
    interval: Interval


@dataclass(frozen=True, kw_only=True)
class Pairs:
    """Counts of matched pairs of runs, by which of the two reached an endpoint, such as a collision."""

    both: int
    first_only: int
    """b of McNemar's test."""
    second_only: int
    """c of McNemar's test."""
    neither: int

    @property
    def n(self) -> int:
        """Number of pairs."""
        return self.both + self.first_only + self.second_only + self.neither

    @property
    def difference(self) -> float:
        """Share of runs of the first that reached the endpoint minus that of the second; n > 0."""
        return (self.first_only - self.second_only) / self.n

    @property
    def interval(self) -> Interval:
        """Newcombe's interval of the difference; n > 0."""
        return newcombe(self)


def pairs_of(outcomes: Sequence[tuple[bool, bool]]) -> Pairs:
    """Count pairs of (first reached the endpoint, second reached it)."""
    return Pairs(
        both=outcomes.count((True, True)),
        first_only=outcomes.count((True, False)),
        second_only=outcomes.count((False, True)),
        neither=outcomes.count((False, False)),
    )


def mcnemar(b: int, c: int) -> float:
    """Return the exact two-sided p-value of McNemar's test [4] for b and c discordant pairs; 1 if there are none."""
    from statsmodels.stats.contingency_tables import mcnemar as test

    return float(test([[0, b], [c, 0]], exact=True).pvalue)


def pairs_needed(discordant: float, effect: float, power: float = 0.8) -> int:
    """Return about how many pairs McNemar's test needs to find a difference of two shares, after Miettinen [7].

    `discordant` is the share of pairs of which one alone reaches the endpoint, at least the effect; both are above 0.
    """
    from scipy.stats import norm

    alpha, beta = float(norm.ppf((1 + LEVEL) / 2)), float(norm.ppf(power))
    discordant = max(discordant, effect)
    return math.ceil((alpha * math.sqrt(discordant) + beta * math.sqrt(discordant - effect**2)) ** 2 / effect**2)


def holm(p_values: Sequence[float]) -> list[float]:
    """Adjust p-values for multiple comparisons after Holm [3], in the given order."""
    from statsmodels.stats.multitest import multipletests

    return multipletests(p_values, method="holm")[1].tolist() if p_values else []


def newcombe(pairs: Pairs) -> Interval:
    """Return Newcombe's interval of the difference of two paired proportions, method 10 [2]; n > 0."""
    n, first, second = pairs.n, pairs.both + pairs.first_only, pairs.both + pairs.second_only
    # The phi coefficient with continuity correction; 0 if one of the outcomes is constant.
    spread = first * (n - first) * second * (n - second)
    product: float = pairs.both * pairs.neither - pairs.first_only * pairs.second_only
    if product > 0:
        product = max(0.0, product - n / 2)
    phi = product / math.sqrt(spread) if spread else 0.0

    def combined(a: float, b: float) -> float:
        return math.sqrt(max(0.0, a * a - 2 * phi * a * b + b * b))

    p1, p2 = first / n, second / n
    w1, w2 = wilson(first, n), wilson(second, n)
    below, above = combined(p1 - w1.low, w2.high - p2), combined(w1.high - p1, p2 - w2.low)
    return Interval(pairs.difference - below, pairs.difference + above)


def bootstrap_ratio(
    strata: Sequence[Sequence[Sequence[float]]], *, seed: int = BOOTSTRAP_SEED, resamples: int = RESAMPLES
) -> Estimate:
    """Return a ratio of sums with the percentile interval of a bootstrap that draws within each stratum.

    A row of a stratum, none of which is empty, is a run: what is counted, and what it is counted per, which is 1 for a
    mean. The row of a pair of runs has both numbers of the first and then those of the second, and the result is the
    difference of the ratios. Of a stratum of n rows n - 1 are drawn: n would vary too little where n is small [6].
    """
    rng = np.random.default_rng(seed)
    arrays = [np.asarray(rows, np.float64) for rows in strata]
    sums = np.zeros((resamples, arrays[0].shape[1]))
    for rows in arrays:
        n = len(rows)
        sums += n * rows[rng.integers(0, n, (resamples, max(n - 1, 1)))].mean(axis=1)
    return Estimate(float(_ratio(np.sum([rows.sum(axis=0) for rows in arrays], axis=0))), percentiles(_ratio(sums)))


def _ratio(sums: FloatArray) -> FloatArray:
    """Return the ratio, or the difference of two ratios, of sums of shape (..., 2) or (..., 4); 0 per 0 is 0."""
    ratios = sums[..., ::2] / np.maximum(sums[..., 1::2], 1e-12)
    return np.asarray(ratios[..., 0] if ratios.shape[-1] == 1 else ratios[..., 0] - ratios[..., 1])


def percentiles(values: Sequence[float] | FloatArray) -> Interval:
    """Return the percentile interval of at least one value at the confidence level."""
    tail = 50 * (1 - LEVEL)
    return Interval(*np.percentile(values, [tail, 100 - tail]).tolist())


@dataclass(frozen=True, kw_only=True)
class DoseCurve:
    """Collision ratio as a function of the noise ratio: `p = 1 - exp(-a theta^b)`.

    This is the complementary log-log model `log(-log(1 - p)) = log a + b log theta` [5]. The ratio grows faster than
    linearly if b > 1.
    """

    a: float
    b: float

    def at(self, theta: float) -> float:
        """Return the collision ratio at a noise ratio."""
        return float(-np.expm1(-self.a * theta**self.b))

    @property
    def ratio(self) -> float:
        """Collision ratio at theta 1 divided by that at theta 0.5, as in the paper."""
        return self.at(1.0) / self.at(0.5)

    @property
    def at_bound(self) -> bool:
        """Whether b lies at a bound of the fit, so that the data do not determine it."""
        return not B_BOUNDS[0] + 1e-6 < self.b < B_BOUNDS[1] - 1e-6


@dataclass(frozen=True, kw_only=True)
class DoseResponse:
    """The maximum-likelihood curve with percentile intervals of a bootstrap."""

    curve: DoseCurve
    seeds: int
    """Number of seeds that were flown at every noise ratio."""
    a: Interval
    b: Interval
    ratio: Interval
    """Interval of `DoseCurve.ratio`."""


def fit_dose_curve(
    thetas: Sequence[float], collisions: Sequence[int], runs: Sequence[int], start: DoseCurve | None = None
) -> DoseCurve:
    """Fit the curve by maximum likelihood to counts at two or more noise ratios above 0.

    `start` affects the speed, and the result only by rounding errors.

    Raises:
        ScenarioError: The data do not determine a curve.
    """
    from scipy.optimize import minimize

    theta, k, n = (np.asarray(values, np.float64) for values in (thetas, collisions, runs))
    if len(theta) < 2 or (theta <= 0).any() or (n <= 0).any() or k.sum() == 0 or (k == n).all():
        raise ScenarioError(
            "a dose response needs runs at two noise ratios above 0, and both runs with and runs without a collision; "
            f"got {k.astype(int).tolist()} of {n.astype(int).tolist()} at theta {theta.tolist()}"
        )
    log_theta = np.log(theta)

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        """Return the negative log-likelihood and its gradient in log a and b, in which it is convex."""
        rate = np.exp(parameters[0] + parameters[1] * log_theta)
        p = -np.expm1(-rate)
        slope = (n - k) * rate - k * rate * np.exp(-rate) / p
        value = ((n - k) * rate - k * np.log(p)).sum()
        return float(value), np.array([slope.sum(), (slope * log_theta).sum()])

    if start is None:
        start = DoseCurve(a=-np.log1p(-k.sum() / n.sum()), b=1.0)
    # L-BFGS-B would wake all threads of OpenBLAS for tiny products, which is up to 50 times slower on a busy machine.
    bounds, fine = [LOG_A_BOUNDS, B_BOUNDS], {"ftol": 1e-13, "gtol": 1e-7, "maxfun": 1000}
    first = np.array([np.log(start.a), start.b])
    found = minimize(loss, first, jac=True, method="TNC", bounds=bounds, options=fine)
    return DoseCurve(a=float(np.exp(found.x[0])), b=float(found.x[1]))


def dose_response(thetas: Sequence[float], collided: MaskImage, *, resamples: int = RESAMPLES) -> DoseResponse:
    """Fit the curve to noise ratios above 0, and estimate its intervals by a bootstrap over seeds, which all share.

    `collided` tells whether each run collided, shape (seeds, thetas). Samples without both runs with and runs without a
    collision are drawn again.

    Raises:
        ScenarioError: The data do not determine a curve.
    """
    above = [i for i, theta in enumerate(thetas) if theta > 0]
    kept, rows = [thetas[i] for i in above], collided[:, above]
    n = [len(rows)] * len(kept)
    curve, rng = fit_dose_curve(kept, rows.sum(axis=0).tolist(), n), np.random.default_rng(BOOTSTRAP_SEED)
    curves: list[DoseCurve] = []
    while len(curves) < resamples:
        counts = rows[rng.integers(0, len(rows), len(rows))].sum(axis=0)
        if 0 < counts.sum() < sum(n):
            curves.append(fit_dose_curve(kept, counts.tolist(), n, start=curve))
    a, b, ratio = (percentiles([getattr(one, name) for one in curves]) for name in ("a", "b", "ratio"))
    return DoseResponse(curve=curve, seeds=len(rows), a=a, b=b, ratio=ratio)


class LogisticCurves:
    """All falling logistic curves of successes over an axis that are considered, with a small share of lapses [8]."""

    def __init__(self, levels: FloatArray, widths: Sequence[float]) -> None:
        """The levels have shape (L,), from the easiest on; the widths of the curves are shares of the axis."""
        grid = np.meshgrid(np.linspace(levels[0], levels[-1], N_PLACES), widths, indexing="ij")
        self.places, scale = (side.ravel() for side in grid)
        """Level at which each curve has fallen to a half, shape (curves,), from the easiest on."""
        beyond = (levels[:, None] - self.places) / (scale * (levels[-1] - levels[0]))
        self.success: FloatArray = (1 - LAPSE) / (1 + np.exp(np.clip(beyond, -50, 50)))
        """Probability of a success at each level for each curve, shape (L, curves)."""

    def likeliest(self, successes: FloatArray, runs: FloatArray) -> FloatArray:
        """Return the place of the likeliest curve for counts of shape (..., L); ends of the axis stand for beyond."""
        log_likelihood = successes @ np.log(self.success) + (runs - successes) @ np.log1p(-self.success)
        return np.asarray(self.places[log_likelihood.argmax(axis=-1)])


def told(estimate: Estimate, levels: FloatArray) -> str:
    """Return a level of an axis as text, or that it may be beyond the levels that were flown: none is extrapolated."""
    low, high = estimate.interval
    if is_beyond(estimate, levels):
        return f"may lie outside of {levels[0]:g} to {levels[-1]:g}"
    return f"{estimate.value:.2f} [{low:.2f}, {high:.2f}]"


def is_beyond(estimate: Estimate, levels: FloatArray) -> bool:
    """Return whether a level may lie beyond the ends of an axis, which stand for what is there."""
    low, high = estimate.interval
    return bool(low <= min(levels) or high >= max(levels))


FIT_WIDTHS = tuple(np.geomspace(0.01, 0.5, 12))
"""Widths of the curves that are fitted to whole studies."""


def success_threshold(levels: FloatArray, arrived: MaskImage) -> Estimate:
    """Return the level at which half of the flights succeed, by maximum likelihood, with a bootstrap over seeds.

    `arrived` has shape (seeds, levels). An end of the axis in the interval stands for all that is beyond it.
    """
    curves, n = LogisticCurves(levels, FIT_WIDTHS), len(arrived)
    runs = np.full(len(levels), float(n))
    return over_seeds(n, lambda rows: curves.likeliest(arrived[rows].sum(axis=-2, dtype=np.float64), runs))


def crossing(levels: FloatArray, values: FloatArray, height: float) -> float:
    """Return the level at which means that fall along the axis have come down to a height; an end for beyond it.

    The means, shape (L,), are made to fall by least squares [9], and joined by straight lines.
    """
    from scipy.optimize import isotonic_regression

    falling = isotonic_regression(values, increasing=False).x
    return float(np.interp(-height, -falling, levels))


def over_seeds(n: int, statistic: SeedStatistic) -> Estimate:
    """Return a statistic of n seeds with the percentile interval of a bootstrap over them."""
    from scipy.stats import bootstrap

    seeds = np.arange(n)
    (value,) = statistic(seeds[None])
    if n == 1:
        return Estimate(float(value), Interval(float(value), float(value)))
    drawn = bootstrap(
        (seeds,),
        lambda rows, axis: statistic(rows),
        n_resamples=RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        rng=BOOTSTRAP_SEED,
    )
    return Estimate(float(value), Interval(*map(float, drawn.confidence_interval)))
