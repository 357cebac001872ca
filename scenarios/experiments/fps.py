"""Table fps: frames per second from files, pipelined and not, beside the paper's other methods."""

from functools import partial

import pandas as pd

from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import create_corrector

from .experiment import WITHIN, Claim, Experiment, ExperimentResult, alike, listed, pivot
from .measures.rates import MEDIAN, PIPELINED, WARM_UP_FRAMES, Setup, frame_rates
from .paper import FRAMES_PER_S, OURS, SWARM
from .plots import picture, plotted

RUNS = 3
PIPELINED_PERCENT, TARGET = 21.9, 20.0
"""By how much pipelining makes the paper's method faster, by its table [%], and its target [frames/s]."""
PAPER = "paper, Jetson Nano [frames/s]"
BLOCKING, LAGGING = (partial(VoxDepth, config=VoxDepthConfig(fusion_lag_frames=lag)) for lag in (0, 3))
"""Fusing stops all, or goes on beside."""
SETUPS = {
    "VD": Setup(LAGGING, PIPELINED),
    "VD-Nopipe": Setup(BLOCKING),
    "VD-Nopipe, fusing beside": Setup(LAGGING),
} | {name: Setup(partial(create_corrector, OURS[name])) for name in ("VD-code", "RS", "GS", "DS") if name in OURS}


def answer(experiment: Experiment) -> ExperimentResult:
    """Time every setup on frames from files, in alternating runs."""
    everyone = pd.MultiIndex.from_product([experiment.sequences, [*SETUPS, SWARM]], names=["sequence", "method"])
    table = frame_rates(experiment, SETUPS, RUNS).reindex(everyone).reset_index()
    table.insert(2, "how", table["method"].map({name: setup.how for name, setup in SETUPS.items()}).fillna("quoted"))
    table["n runs"] = table["method"].isin(SETUPS) * RUNS
    table[PAPER] = table["method"].map(FRAMES_PER_S)
    shown = pivot(table, "method", "sequence", MEDIAN).assign(**{PAPER: pd.Series(FRAMES_PER_S)})[::-1]
    title = f"Frame rates, median of {RUNS} runs of {experiment.frames} frames; the paper's target is {TARGET:g}"
    figure = picture(title, [plotted(shown, "", "frames per second", "", kind="barh")])
    return ExperimentResult(table=table, figure=figure)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about the gain of the pipeline, the rate, and the order of the methods."""
    medians = pivot(table, "method", "sequence", MEDIAN)
    gain = 100 * (medians.loc["VD"] / medians.loc["VD-Nopipe"] - 1)
    orders = {name: ", ".join(of[["RS", "VD", "GS"]].sort_values()[::-1].index) for name, of in medians.items()}
    return (
        Claim(
            "pipelining makes it 21 % faster (26.71 and 21.91 frames/s: 21.9 %)",
            listed(gain, "+.1f", "%"),
            all(alike(of, PIPELINED_PERCENT) for of in gain),
            f"{WITHIN}, in every sequence",
        ),
        Claim(
            "it corrects more than 20 frames/s (26.71)",
            listed(medians.loc["VD"], ".1f", "frames/s"),
            bool((medians.loc["VD"] >= TARGET).all()),
            "it does in every sequence",
        ),
        Claim(
            "RS is faster than VD, and VD than GS (39.52, 26.71 and 16.89 frames/s)",
            "from fast to slow: " + "; ".join(f"{name} {order}" for name, order in orders.items()),
            set(orders.values()) == {"RS, VD, GS"},
            "it is the order in every sequence",
        ),
    )


EXPERIMENT = Experiment(
    question="How many frames per second does each method correct, reading included?",
    answer=answer,
    claims=claims,
    notes=(
        "The gray PNG and the depth TIFF of each frame are read; OpenCV is on one thread. VD and VD-Nopipe, fusing "
        "beside, have one more thread that fuses. VD-code is what the code of the paper's authors does, DS our "
        "corrector learned, GS our reconstruction in NumPy; the rate of Swarm, of Kabore and Gueler, is quoted as the "
        "paper does.",
    ),
    sequences=("sim-LN",),
    frames=100,
    least_frames=WARM_UP_FRAMES,
    width_px=640,
)
