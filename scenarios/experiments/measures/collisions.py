"""Runs of the study `noise` in which drones collide, counted by the noise of their depth, and a curve through them."""

import os

import pandas as pd

from swarm.types import Outcome

from ...provenance import simulation_versions
from ...study.analysis import curves, run_frame
from ...study.design import Study, load_study
from ...study.executors import Processes
from ...study.run import run_study
from ...study.statistics import cloglog_curve, wilson
from ...study.store import StudyData
from ..experiment import Experiment

WHOLE, ARM = "noise", "one draw per object"
"""The whole study, and its arm that the small form flies."""
THETAS = (0.3, 0.5, 0.7, 0.9, 1.0)
"""Noise ratios of the small form."""
THETA, SHARE = "noise ratio theta", "runs with a collision [%]"
EXPONENT = ["exponent", "exponent, low", "exponent, high"]
GROWTH = ["growth", "growth, low", "growth, high"]
"""Columns of the fitted curve: its exponent, and its size at a ratio of 1 over that at 0.5, with their intervals."""


def fly_small_study(experiment: Experiment) -> StudyData:
    """Fly the missions of the small form that are not in the folder of the results yet."""
    study = small_study(experiment.frames, experiment.seed)
    code = simulation_versions()["code"]
    folder = experiment.out / "collide" / f"study-{study.seeds.count}-seeds-from-{study.seeds.first}-{code[:12]}"
    executor = Processes(os.cpu_count() or 1, study.time_limit_s)
    return run_study(study, folder, executor, experiment.report, resume=True)


def small_study(count: int, skipped: int = 0) -> Study:
    """Return one arm of the whole study at a few noise ratios, with its first seeds or those after some."""
    whole = load_study(WHOLE)
    (arm,) = (arm.model_copy(update={"theta": THETAS}) for arm in whole.arms if arm.name == ARM)
    seeds = whole.seeds.model_copy(update={"count": count, "first": whole.seeds.first + skipped})
    return whole.model_copy(update={"name": f"{WHOLE}-small", "arms": (arm,), "seeds": seeds})


def collision_table(data: StudyData) -> pd.DataFrame:
    """Return a row for each arm and noise ratio, over seeds with a run at every ratio, and each arm's fitted curve."""
    runs, rows = run_frame(data), []
    for (_, arm), collided in curves(data, runs, runs["outcome"] == Outcome.COLLISION).items():
        above = collided.loc[:, collided.columns > 0].astype(bool)
        exponent, growth = cloglog_curve(above.columns.to_numpy(float), above.to_numpy())
        fit = dict(zip(EXPONENT + GROWTH, (*exponent, *growth), strict=True))
        for theta, of in collided.items():
            k, n = int(of.sum()), len(of)
            shares = dict(zip((SHARE, "low [%]", "high [%]"), wilson(k, n).scaled(100), strict=True))
            rows.append({"arm": arm, THETA: float(theta), "collisions": k, "n runs": n, **shares, **fit})
    return pd.DataFrame(rows)
