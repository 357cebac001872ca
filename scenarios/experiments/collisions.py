"""Fig. collide: how often drones collide as the noise of their depth grows, in a small form of the study `noise`."""

import os
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.optimize import minimize

from swarm.types import Outcome
from voxdepth.tools.figure import panels, plotted
from voxdepth.types import FloatArray, MaskImage

from ..study.analysis import arms_of, curves, run_frame
from ..study.design import Study, load_study
from ..study.executors import Processes
from ..study.run import run_study
from ..study.statistics import BOOTSTRAP_SEED, RESAMPLES, Estimate, percentiles
from ..study.tables import end_table
from .experiment import Claim, ExperimentContext, Findings, asks

WHOLE, ARM = "noise", "one draw per object"
"""The whole study, and its arm that this one flies."""
THETAS, SEEDS = (0.3, 0.5, 0.7, 0.9, 1.0), 5
"""Noise ratios from the paper's smallest to its largest, all of the whole study."""
GROWTH = 8.0
"""How many times as many collisions the paper finds at twice a noise ratio of 0.5."""
LOG_A_BOUNDS, B_BOUNDS = (-15.0, 5.0), (0.0, 12.0)
"""Bounds of the fit. The likelihood may grow with b without limit; then the fit ends at a bound."""


@asks("How do collisions grow with the noise of the depth (Fig. collide)?", sequences=(), frames=SEEDS)
def collide(context: ExperimentContext) -> Findings:
    """Fly the missions that are not in the folder of the results yet, and fit the collisions."""
    study = small_study(context.frames, context.seed)
    executor = Processes(os.cpu_count() or 1, study.time_limit_s)
    folder = context.out / "collide" / "study"
    data = run_study(study, folder, executor, context.report, resume=True)
    runs = run_frame(data)
    arms, collided = arms_of(runs), curves(data, runs, runs["outcome"] == Outcome.COLLISION)
    growth = fit_growth(np.array(THETAS), next(iter(collided.values())).to_numpy(bool))
    ratios = pd.DataFrame({ARM: {arm.level: 100 * arm.count(Outcome.COLLISION) / arm.n for arm in arms}})
    return Findings(
        tables={"table": end_table(arms).frame()},
        claims=_claims(growth),
        notes=(
            f"Seeds {study.seeds.first} and up; --frames sets their number. So few tell little: the whole "
            f"study is `voxdepth study run {WHOLE}`. One draw of the noise holds for all pixels of an object.",
        ),
        figure=panels(
            f"Collisions of {study.scenarios[0]}, n = {context.frames} missions at each noise ratio",
            [plotted(ratios, "", "noise ratio theta", "missions with a collision [%]")],
        ),
    )


def small_study(count: int, first_seed: int | None = None) -> Study:
    """One arm of the whole study at a few noise ratios, with a few seeds, by default its first ones."""
    whole = load_study(WHOLE)
    (arm,) = (arm.model_copy(update={"theta": THETAS}) for arm in whole.arms if arm.name == ARM)
    first = whole.seeds.first if first_seed is None else first_seed
    fewer = whole.seeds.model_copy(update={"count": count, "first": first})
    return whole.model_copy(update={"name": f"{WHOLE}-small", "arms": (arm,), "seeds": fewer})


class Growth(NamedTuple):
    """How the collision ratio grows with the noise ratio theta: as `p = 1 - exp(-a theta^b)`.

    This is the complementary log-log model `log(-log(1 - p)) = log a + b log theta` [1]_. The ratio grows faster than
    linearly if b > 1.

    References:
        .. [1] McCullagh, Nelder, Generalized Linear Models (1989), Section 4.3.
    """

    exponent: Estimate
    """b."""
    ratio: Estimate
    """Collision ratio at theta 1 divided by that at theta 0.5, as in the paper."""


def fit_growth(theta: FloatArray, collided: MaskImage) -> Growth | None:
    """Fit the curve by maximum likelihood, with intervals of a bootstrap over seeds, which all noise ratios share.

    `collided` tells whether each run collided, shape (seeds, T), by noise ratios above 0, shape (T,). Samples without
    both runs with and runs without a collision are drawn again; None if there are not both.
    """
    rng, samples = np.random.default_rng(BOOTSTRAP_SEED), [collided]
    if not 0 < collided.sum() < collided.size:
        return None
    while len(samples) <= RESAMPLES:
        sample = collided[rng.integers(0, len(collided), len(collided))]
        if 0 < sample.sum() < sample.size:
            samples.append(sample)
    curves = np.array([_likeliest(theta, sample.sum(axis=0), len(sample)) for sample in samples])
    ratios = _collision_ratio(curves, 1.0) / _collision_ratio(curves, 0.5)
    exponent, ratio = (Estimate(float(own[0]), percentiles(own[1:])) for own in (curves[:, 1], ratios))
    return Growth(exponent, ratio)


def _collision_ratio(curves: FloatArray, theta: float) -> FloatArray:
    """Return the collision ratio at a noise ratio of curves by a and b, shape (curves, 2)."""
    return np.asarray(-np.expm1(-curves[:, 0] * theta ** curves[:, 1]))


def _likeliest(theta: FloatArray, k: FloatArray, n: int) -> tuple[float, float]:
    """Return a and b that make it likeliest that k of n runs collide at each noise ratio, shapes (T,)."""
    log_theta = np.log(theta)

    def loss(parameters: FloatArray) -> tuple[float, FloatArray]:
        """Return the negative log-likelihood and its gradient in log a and b, in which it is convex."""
        rate = np.exp(parameters[0] + parameters[1] * log_theta)
        p = -np.expm1(-rate)
        slope = (n - k) * rate - k * rate * np.exp(-rate) / p
        value = ((n - k) * rate - k * np.log(p)).sum()
        return float(value), np.array([slope.sum(), (slope * log_theta).sum()])

    # L-BFGS-B would wake all threads of OpenBLAS for tiny products, which is up to 50 times slower on a busy machine.
    bounds, fine = [LOG_A_BOUNDS, B_BOUNDS], {"ftol": 1e-13, "gtol": 1e-7, "maxfun": 1000}
    constant = np.array([np.log(-np.log1p(-k.mean() / n)), 1.0])
    found = minimize(loss, constant, jac=True, method="TNC", bounds=bounds, options=fine)
    return float(np.exp(found.x[0])), float(found.x[1])


def _claims(growth: Growth | None) -> tuple[Claim, Claim]:
    """The shape of the growth, and its size; open where the missions have no fit or leave it undecided."""
    shape = "collisions grow faster than linearly with the noise ratio"
    size = "from a noise ratio of 0.5 to one of 1, collisions grow 8 times"
    superlinear, contained = "the exponent is above 1 with its interval", "8 times lies in the interval"
    if growth is None:
        no_fit = "no fit: it takes both missions with and missions without a collision"
        return Claim(shape, no_fit, None, superlinear), Claim(size, no_fit, None, contained)
    (b_value, b), (ratio_value, ratio) = growth
    interval, is_decided = "with a 95 % interval of {:.2f} to {:.2f}", b.low > 1 or b.high < 1
    exponent = f"as theta^{b_value:.2f}, {interval.format(*b)}"
    times = f"{ratio_value:.1f} times, {interval.format(*ratio)}"
    return (
        Claim(shape, exponent, b.low > 1 if is_decided else None, superlinear),
        Claim(size, times, ratio.low <= GROWTH <= ratio.high, contained),
    )
