"""How the collision ratio grows with the noise ratio: `p = 1 - exp(-a theta^b)`, fitted by likelihood.

b > 1 is growth faster than linear. Seeds are shared by all noise ratios, so the bootstrap draws whole seeds: the rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from voxdepth.types import FloatArray, MaskImage

from ..errors import ScenarioError
from .statistics import Interval, percentiles

RESAMPLES = 1000
SEED = 20240601
"""Of the bootstrap."""
LOG_A_BOUNDS, B_BOUNDS = (-15.0, 5.0), (0.0, 12.0)
"""Where the fit looks. Nothing in the data may speak against an infinite b; then it ends at a bound, and says so."""
LOW, HIGH = 0.5, 1.0
"""Noise ratios whose collision ratios are compared, as in the paper."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """`p = 1 - exp(-a theta^b)`."""

    a: float
    b: float

    def at(self, theta: float) -> float:
        """The collision ratio at a noise ratio."""
        return float(-np.expm1(-self.a * theta**self.b))

    @property
    def ratio(self) -> float:
        """Collision ratio at theta 1 by that at 0.5, by the curve."""
        return self.at(HIGH) / self.at(LOW)

    @property
    def at_bound(self) -> bool:
        """Whether the data do not say how steep it is."""
        return not B_BOUNDS[0] + 1e-6 < self.b < B_BOUNDS[1] - 1e-6


@dataclass(frozen=True, kw_only=True)
class Growth:
    """A fit with its intervals, each 95 % of the bootstrap."""

    curve: Curve
    thetas: tuple[float, ...]
    """Those that were fitted; 0 is left out, for there the curve is 0 whatever a and b are."""
    seeds: int
    """Rows: seeds that were flown at every theta."""
    a: Interval
    b: Interval
    ratio: Interval
    """Of `Curve.ratio`."""
    resamples: int
    """That could be fitted: those without any collision could not."""
    bootstrap_seed: int


def fit(thetas: Sequence[float], collisions: Sequence[int], runs: Sequence[int], near: Curve | None = None) -> Curve:
    """The most likely curve.

    Args:
        thetas: Noise ratios above 0, at least two.
        collisions: At each of them.
        runs: At each of them, above 0.
        near: Where to begin; it changes the speed, and the result by no more than rounding.

    Raises:
        ScenarioError: There is too little to fit.
    """
    from scipy.optimize import minimize

    theta, k = np.asarray(thetas, np.float64), np.asarray(collisions, np.float64)
    n = np.asarray(runs, np.float64)
    if len(theta) < 2 or (theta <= 0).any() or (n <= 0).any() or k.sum() == 0 or (k == n).all():
        raise ScenarioError(
            "a growth curve needs runs at two noise ratios above 0, and both runs with and runs without a collision; "
            f"got {k.astype(int).tolist()} of {n.astype(int).tolist()} at theta {theta.tolist()}"
        )
    log_theta = np.log(theta)

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        """Negative log-likelihood and its gradient, in log a and b; it is convex in them."""
        rate = np.exp(parameters[0] + parameters[1] * log_theta)
        p = -np.expm1(-rate)
        slope = (n - k) * rate - k * rate * np.exp(-rate) / p
        value = ((n - k) * rate - k * np.log(p)).sum()
        return float(value), np.array([slope.sum(), (slope * log_theta).sum()])

    if near is None:
        near = Curve(a=-np.log1p(-k.sum() / n.sum()), b=1.0)
    start = np.array([np.log(near.a), near.b])
    # TNC and not L-BFGS-B, whose tiny products wake all threads of OpenBLAS: up to 50 times slower on a busy machine.
    bounds, fine = [LOG_A_BOUNDS, B_BOUNDS], {"ftol": 1e-13, "gtol": 1e-7, "maxfun": 1000}
    found = minimize(loss, start, jac=True, method="TNC", bounds=bounds, options=fine)
    return Curve(a=float(np.exp(found.x[0])), b=float(found.x[1]))


def growth(thetas: Sequence[float], collided: MaskImage, *, seed: int = SEED, resamples: int = RESAMPLES) -> Growth:
    """The most likely curve and its intervals by a bootstrap over seeds.

    Args:
        thetas: Noise ratios.
        collided: Whether each run collided, a row for each seed and a column for each theta.
        seed: Of the bootstrap.
        resamples: How many times the rows are drawn anew.

    Raises:
        ScenarioError: There is too little to fit.
    """
    above = [i for i, theta in enumerate(thetas) if theta > 0]
    kept, rows = [thetas[i] for i in above], collided[:, above]
    n = [len(rows)] * len(kept)
    curve = fit(kept, rows.sum(axis=0).tolist(), n)
    rng = np.random.default_rng(seed)
    curves = []
    for _ in range(resamples):
        counts = rows[rng.integers(0, len(rows), len(rows))].sum(axis=0)
        if 0 < counts.sum() < sum(n):
            curves.append(fit(kept, counts.tolist(), n, near=curve))
    if not curves:
        raise ScenarioError("no draw of the bootstrap had both runs with and runs without a collision: fly more seeds")
    return Growth(
        curve=curve,
        thetas=tuple(kept),
        seeds=len(rows),
        a=percentiles([c.a for c in curves]),
        b=percentiles([c.b for c in curves]),
        ratio=percentiles([c.ratio for c in curves]),
        resamples=len(curves),
        bootstrap_seed=seed,
    )
