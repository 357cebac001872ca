"""Fig. collide: how often drones collide as the noise of their depth grows, by a store of the study `noise`."""

import os

import pandas as pd

from swarm.types import Outcome

from ..errors import ScenarioError
from ..study.analysis import curves, run_frame
from ..study.design import Study, load_study
from ..study.executors import Processes
from ..study.run import run_study
from ..study.statistics import cloglog_curve, wilson
from ..study.store import StudyData, read_study
from .experiment import Claim, Experiment, ExperimentResult
from .plots import picture, plotted

WHOLE, ARM = "noise", "one draw per object"
"""The whole study, and its arm that this one flies."""
THETAS, SEEDS, GROWTH = (0.3, 0.5, 0.7, 0.9, 1.0), 5, 8.0
"""Noise ratios of the small form, its seeds, and how many times as many collisions the paper has at 1 as at 0.5."""
THETA, SHARE = "noise ratio theta", "runs with a collision [%]"
FIT = ["exponent", "exponent, low", "exponent, high", "growth", "growth, low", "growth, high"]
"""Columns of the fitted curve: its exponent, and its size at a ratio of 1 over that at 0.5."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Read a store of the study, or fly what its small form lacks."""
    if len(experiment.data) > 1:
        raise ScenarioError(f"expected one store of the study {WHOLE}, got {len(experiment.data)}: name one")
    data = (
        read_study(experiment.data[0])
        if experiment.data
        else fly(small_study(experiment.frames, experiment.seed), experiment)
    )
    table = table_of(data)
    shown = table.pivot(index=THETA, columns="arm", values=SHARE)
    return ExperimentResult(table=table, figure=picture("Collisions of the swarm", [plotted(shown, "", THETA, SHARE)]))


def fly(study: Study, experiment: Experiment) -> StudyData:
    """Fly the missions that are not in the folder of the results yet."""
    executor = Processes(os.cpu_count() or 1, study.time_limit_s)
    return run_study(study, experiment.out / "collide" / "study", executor, experiment.report, resume=True)


def small_study(count: int, skipped: int = 0) -> Study:
    """Return one arm of the whole study at a few noise ratios, with its first seeds or those after some."""
    whole = load_study(WHOLE)
    (arm,) = (arm.model_copy(update={"theta": THETAS}) for arm in whole.arms if arm.name == ARM)
    seeds = whole.seeds.model_copy(update={"count": count, "first": whole.seeds.first + skipped})
    return whole.model_copy(update={"name": f"{WHOLE}-small", "arms": (arm,), "seeds": seeds})


def table_of(data: StudyData) -> pd.DataFrame:
    """Return a row for each arm and noise ratio, over seeds with a run at every ratio, and each arm's fitted curve."""
    runs, rows = run_frame(data), []
    for (_, arm), collided in curves(data, runs, runs["outcome"] == Outcome.COLLISION).items():
        above = collided.loc[:, collided.columns > 0].astype(bool)
        exponent, growth = cloglog_curve(above.columns.to_numpy(float), above.to_numpy())
        fit = dict(zip(FIT, (*exponent, *growth), strict=True))
        for theta, of in collided.items():
            k, n = int(of.sum()), len(of)
            shares = dict(zip((SHARE, "low [%]", "high [%]"), wilson(k, n).scaled(100), strict=True))
            rows.append({"arm": arm, THETA: float(theta), "collisions": k, "n runs": n, **shares, **fit})
    return pd.DataFrame(rows)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return what follows of the shape of the growth and its size in each arm; open where the runs do not decide it."""
    found: list[Claim] = []
    for arm, of in table.groupby("arm", sort=False):
        untold = f"{arm}: {of['collisions'].sum()} of {of['n runs'].sum()} runs collided, which fits any curve"
        b, b_low, b_high = of[FIT[:3]].iloc[0]
        ratio, low, high = of[FIT[3:]].iloc[0]
        found += [
            Claim(
                "collisions grow faster than linearly with the noise ratio, almost quadratically",
                f"{arm}: as theta^{b:.1f}, with a 95 % interval of {b_low:.1f} to {b_high:.1f}" if b >= 0 else untold,
                bool(b_low > 1) if b_low > 1 or b_high < 1 else None,
                "the exponent is above 1 with its interval",
            ),
            Claim(
                f"from a noise ratio of 0.5 to one of 1, collisions grow {GROWTH:g} times",
                f"{arm}: {ratio:.1f} times, with a 95 % interval of {low:.1f} to {high:.1f}" if b >= 0 else untold,
                bool(low <= GROWTH <= high) if low <= high else None,
                f"{GROWTH:g} times lies in the interval",
            ),
        ]
    return tuple(found)


EXPERIMENT = Experiment(
    question="How do collisions grow with the noise of the depth?",
    answer=answer,
    claims=claims,
    notes=(
        f"Without --data {SEEDS} seeds fly at {len(THETAS)} noise ratios, with one draw of the noise for all pixels "
        "of an object; --frames sets the number of seeds. So few tell little: the whole study is `voxdepth study run "
        f"{WHOLE}`.",
        "The curve is p = 1 - exp(-a theta^b), with the exponent b; growth is p(1) / p(0.5). Intervals of both are of "
        "a bootstrap over seeds, those of shares are Wilson's.",
    ),
    frames=SEEDS,
)
