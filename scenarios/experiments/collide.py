"""Fig. collide: how often drones collide as the noise of their depth grows, by a store of the study `noise`."""

import pandas as pd

from ..errors import ScenarioError
from ..study.store import read_study
from .experiment import ALIKE, Claim, Experiment, ExperimentResult, alike
from .measures.collisions import EXPONENT, GROWTH, SHARE, THETA, THETAS, WHOLE, collision_table, fly_small_study
from .plots import picture, plotted

SEEDS, PAPER_GROWTH = 5, 8.0
"""Seeds of the small form, and how many times as many collisions the paper has at a noise ratio of 1 as at 0.5."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Read a store of the study, or fly what its small form lacks."""
    if len(experiment.data) > 1:
        raise ScenarioError(f"expected one store of the study {WHOLE}, got {len(experiment.data)}: name one")
    data = read_study(experiment.data[0]) if experiment.data else fly_small_study(experiment)
    table = collision_table(data)
    if table.empty:
        raise ScenarioError(f"expected runs of the study {WHOLE} at several noise ratios, got {data.study.name}")
    shown = table.pivot(index=THETA, columns="arm", values=SHARE)
    return ExperimentResult(table=table, figure=picture("Collisions of the swarm", [plotted(shown, "", THETA, SHARE)]))


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return what follows of the shape of the growth and its size in each arm; open where the runs do not decide it."""
    found: list[Claim] = []
    for arm, of in table.groupby("arm", sort=False):
        untold = f"{arm}: {of['collisions'].sum()} of {of['n runs'].sum()} runs collided, which fits any curve"
        b, b_low, b_high = of[EXPONENT].iloc[0]
        ratio, low, high = of[GROWTH].iloc[0]
        found += [
            Claim(
                "collisions grow faster than linearly with the noise ratio, almost quadratically",
                f"{arm}: as theta^{b:.1f}, with a 95 % interval of {b_low:.1f} to {b_high:.1f}" if b >= 0 else untold,
                bool(b_low > 1) if b_low > 1 or b_high < 1 else None,
                "the exponent is above 1 with its interval",
            ),
            Claim(
                f"from a noise ratio of 0.5 to one of 1, collisions grow {PAPER_GROWTH:g} times",
                f"{arm}: {ratio:.1f} times, with a 95 % interval of {low:.1f} to {high:.1f}" if b >= 0 else untold,
                _is_like_the_paper(low, high),
                f"the whole interval is within a factor of {ALIKE:g}; it differs if {PAPER_GROWTH:g} lies outside",
            ),
        ]
    return tuple(found)


def _is_like_the_paper(low: float, high: float) -> bool | None:
    """Return whether an interval of the growth agrees with the paper's; None where it decides nothing."""
    if low > PAPER_GROWTH or high < PAPER_GROWTH:
        return False
    return True if alike(low, PAPER_GROWTH) and alike(high, PAPER_GROWTH) else None


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
