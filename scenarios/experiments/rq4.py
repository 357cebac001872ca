"""RQ4: registration against dense optical flow, in quality and in time."""

import pandas as pd

from voxdepth.paper.config import VoxDepthConfig

from .experiment import Claim, Experiment, ExperimentResult, all_hold, listed, most_hold, pivot
from .image_motion import DEPTH, TIME, UNMOVED, by_flow, by_registration, score_pairs
from .optical_flow import FLOWS
from .paper import FLOW_S
from .plots import picture, plotted

DISTANCES, MAX_PAIRS = (1, 3, 10, 25), 4
"""Frames between the earlier and the later image, and pairs of each distance in a sequence."""
REGISTRATION, DIS, DISTANCE = "registration", "DIS flow", "distance [frames]"
BUDGET_MS = 50.0
"""The paper's limit for a frame: 20 frames per second."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Warp a perfect template, which is the true depth of a frame, to later frames with every method."""
    scores = {}
    for name in experiment.sequences:
        registration = by_registration(VoxDepthConfig(), experiment.recording(name).intrinsics.shape)
        estimators = UNMOVED | {REGISTRATION: registration} | {flow: by_flow(FLOWS[flow]) for flow in FLOWS}
        for distance in (distance for distance in DISTANCES if distance < experiment.frames):
            scores[name, distance] = score_pairs(experiment, name, estimators, distance, MAX_PAIRS)
    table = pd.concat(scores, names=["sequence", DISTANCE, "method"]).reset_index()
    panels = [
        plotted(pivot(of, DISTANCE, "method", DEPTH), f"{name}, surfaces within 20 m", DISTANCE, DEPTH, logy=True)
        for name, of in table.groupby("sequence", sort=False)
    ]
    times_ms = _times_ms(table).T
    panels.append(plotted(times_ms, "median; the paper's limit is 50 ms", "", "time [ms]", kind="bar", logy=True))
    return ExperimentResult(
        table=table, figure=picture("RQ4: a perfect template warped to later frames", panels, columns=2)
    )


def _times_ms(table: pd.DataFrame) -> pd.DataFrame:
    """Return the times at the shortest distance, by sequence and method: they do not depend on it."""
    return pivot(table[table[DISTANCE] == DISTANCES[0]], "sequence", "method", TIME).drop(columns=list(UNMOVED))


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
