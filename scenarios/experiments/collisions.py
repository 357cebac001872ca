"""Fig. collide: how often drones collide as the noise of their depth grows, in a small form of the study `noise`."""

import os

import pandas as pd

from voxdepth.tools.figure import panels, plotted

from ..study.analysis import dose_responses, summarise_arms
from ..study.design import Study, load_study
from ..study.executors import Processes
from ..study.run import run_study
from ..study.statistics import DoseResponse
from ..study.tables import arm_table, dose_response_table
from .experiment import Claim, ExperimentContext, Findings, asks

WHOLE, ARM = "noise", "one draw per object"
"""The whole study, and its arm that this one flies."""
THETAS, SEEDS = (0.3, 0.5, 0.7, 0.9, 1.0), 5
"""Noise ratios from the paper's smallest to its largest, all of the whole study."""
GROWTH = 8.0
"""How many times as many collisions the paper finds at twice a noise ratio of 0.5."""


@asks("How do collisions grow with the noise of the depth (Fig. collide)?", sequences=(), frames=SEEDS)
def collide(context: ExperimentContext) -> Findings:
    """Fly the missions that are not in the folder of the results yet, and fit the collisions."""
    study = small_study(context.frames, context.seed)
    executor = Processes(os.cpu_count() or 1, study.time_limit_s)
    folder = context.out / "collide" / "study"
    data = run_study(study, folder, executor, lambda progress: context.report(progress.line()), resume=True)
    arms, responses = summarise_arms(data), list(dose_responses(data))
    ratios = pd.DataFrame({ARM: {arm.level: 100 * (arm.ratio or 0.0) for arm in arms}})
    return Findings(
        tables={"table": arm_table(arms).frame(), "dose": dose_response_table(responses).frame()},
        claims=_claims(next(response for _, name, response in responses if name == ARM)),
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


def _claims(response: DoseResponse | str) -> tuple[Claim, Claim]:
    """The shape of the growth, and its size; open where the missions have no fit or leave it undecided."""
    shape = "collisions grow faster than linearly with the noise ratio"
    size = "from a noise ratio of 0.5 to one of 1, collisions grow 8 times"
    superlinear, contained = "the exponent is above 1 with its interval", "8 times lies in the interval"
    if isinstance(response, str):
        return Claim(shape, response, None, superlinear), Claim(size, response, None, contained)
    b, ratio, curve = response.b, response.ratio, response.curve
    interval, is_decided = "with a 95 % interval of {:.2f} to {:.2f}", b.low > 1 or b.high < 1
    exponent = f"as theta^{curve.b:.2f}, {interval.format(*b)}"
    growth = f"{curve.ratio:.1f} times, {interval.format(*ratio)}"
    return (
        Claim(shape, exponent, b.low > 1 if is_decided else None, superlinear),
        Claim(size, growth, ratio.low <= GROWTH <= ratio.high, contained),
    )
