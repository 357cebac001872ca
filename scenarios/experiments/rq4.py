"""RQ4: registration against dense optical flow, in quality and in time."""

import pandas as pd

from voxdepth.paper.config import VoxDepthConfig

from .experiment import Claim, Experiment, ExperimentResult, all_hold, listed, most_hold, pivot
from .measures.image_motion import UNMOVED, by_flow, by_registration
from .measures.optical_flow import FLOWS
from .measures.pairs import DEPTH, DISTANCE, TIME, Pairs, score_pairs
from .paper import FLOW_S
from .plots import picture, plotted

PAIRS = Pairs(distances_frames=(1, 3, 10, 25), at_most=4)
REGISTRATION, DIS = "registration", "DIS flow"
ESTIMATORS = {**UNMOVED, REGISTRATION: by_registration(VoxDepthConfig()), **{of: by_flow(FLOWS[of]) for of in FLOWS}}
BUDGET_MS = 50.0
"""The paper's limit for a frame: 20 frames per second."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Warp a perfect template, which is the true depth of a frame, to later frames with every method."""
    table = experiment.of_each(lambda name: score_pairs(experiment, name, PAIRS, ESTIMATORS))
    panels = [
        plotted(pivot(of, DISTANCE, "method", DEPTH), f"{name}, surfaces within 20 m", DISTANCE, DEPTH, logy=True)
        for name, of in table.groupby("sequence", sort=False)
    ]
    times_ms = _times_ms(table).T
    panels.append(plotted(times_ms, "median; the paper's limit is 50 ms", "", "time [ms]", kind="bar", logy=True))
    figure = picture("RQ4: a perfect template warped to later frames", panels, columns=2)
    return ExperimentResult(table=table, figure=figure)


def _times_ms(table: pd.DataFrame) -> pd.DataFrame:
    """Return the times at the shortest distance, by sequence and method: they do not depend on it."""
    nearest = table[table[DISTANCE] == table[DISTANCE].min()]
    return pivot(nearest, "sequence", "method", TIME).drop(columns=list(UNMOVED))


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about the times of flows, and about the error of the fastest beside that of registration."""
    flows_ms = _times_ms(table)[list(FLOWS)]
    is_over = (flows_ms > BUDGET_MS).to_numpy().ravel()
    found = "; ".join(f"{name} {listed(of_flows_ms, '.1f', 'ms')}" for name, of_flows_ms in flows_ms.iterrows())
    errors_m = table.pivot(index=["sequence", DISTANCE], columns="method", values=DEPTH)[[REGISTRATION, DIS]].dropna()
    is_better = errors_m[DIS] < errors_m[REGISTRATION]
    return (
        Claim(
            f"optical flow takes far longer than the 50 ms of a frame: Horn-Schunck {FLOW_S['Horn-Schunck']} s, RAFT "
            f"{FLOW_S['RAFT']} s, on a Jetson Nano",
            f"{found} (median); {is_over.sum()} of {is_over.size} flows take over 50 ms",
            all_hold(is_over),
            "every flow does",
        ),
        Claim(
            "flow predicts the movement of objects at a pixel level, more amenable to motion than registration",
            f"{DIS} leaves the smaller mean error of depth in {is_better.sum()} of {len(is_better)} sequences and "
            "distances",
            most_hold(is_better),
            "flow is better in more than half",
        ),
    )


EXPERIMENT = Experiment(
    question="Does optical flow move a template better than registration, and what does it cost?",
    answer=answer,
    claims=claims,
    notes=(
        "The template is the true depth of the earlier frame, so that only the motion is scored, on the pixels that "
        "all methods cover. A registration that fails warps nothing. Times are of finding the motion and warping one "
        "depth image, on one thread; the features of the template are found once, before. RAFT, a network, is not "
        "built in.",
    ),
    sequences=("sim-LN", "sim-MB", "sim-PLF"),
    frames=30,
    least_frames=2,
    width_px=640,
)
