"""Table fps: frames per second from files, pipelined and not, beside the paper's other methods."""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pandas as pd

from voxdepth import CorrectionPipeline, VoxDepth
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import create_corrector
from voxdepth.types import Intrinsics

from .experiment import WITHIN, Claim, Experiment, ExperimentResult, alike, listed, pivot
from .paper import FRAMES_PER_S, OURS, SWARM
from .plots import picture, plotted

RUNS, WARM_UP_FRAMES = 3, 16
"""Runs of each setup, which alternate, so that other load slows all of them; and frames of one more before these."""
PIPELINED_PERCENT, TARGET = 21.9, 20.0
"""By how much pipelining makes the paper's method faster, by its table [%], and its target [frames/s]."""
ONE_BY_ONE, PIPELINED = "one by one", "three stages in threads"
MEDIAN, PAPER = "median [frames/s]", "paper, Jetson Nano [frames/s]"
Setup = tuple[Callable[[Intrinsics], Any], str]
"""A function that creates the corrector, and how it is run."""
BLOCKING, LAGGING = (partial(VoxDepth, config=VoxDepthConfig(fusion_lag_frames=lag)) for lag in (0, 3))
"""Fusing stops all, or goes on beside."""
SETUPS: dict[str, Setup] = {
    "VD": (LAGGING, PIPELINED),
    "VD-Nopipe": (BLOCKING, ONE_BY_ONE),
    "VD-Nopipe, fusing beside": (LAGGING, ONE_BY_ONE),
    **{
        name: (partial(create_corrector, OURS[name]), ONE_BY_ONE)
        for name in ("VD-code", "RS", "GS", "DS")
        if name in OURS
    },
}


def answer(experiment: Experiment) -> ExperimentResult:
    """Time every setup on frames from files, in alternating runs."""
    rates = pd.DataFrame(_timed(experiment)).groupby(["sequence", "method"], sort=False)["rate"]
    spread = rates.agg(**{MEDIAN: "median", "lowest [frames/s]": "min", "highest [frames/s]": "max"})
    everyone = pd.MultiIndex.from_product([experiment.sequences, [*SETUPS, SWARM]], names=["sequence", "method"])
    table = spread.reindex(everyone).reset_index()
    table.insert(2, "how", table["method"].map({name: how for name, (_, how) in SETUPS.items()}).fillna("quoted"))
    table["n runs"] = table["method"].isin(SETUPS) * RUNS
    table[PAPER] = table["method"].map(FRAMES_PER_S)
    shown = pivot(table, "method", "sequence", MEDIAN).assign(**{PAPER: pd.Series(FRAMES_PER_S)})[::-1]
    title = f"Frame rates, median of {RUNS} runs of {experiment.frames} frames; the paper's target is {TARGET:g}"
    return ExperimentResult(
        table=table, figure=picture(title, [plotted(shown, "", "frames per second", "", kind="barh")])
    )


def _timed(experiment: Experiment) -> Iterator[dict[str, Any]]:
    """Yield the rate of every setup on every sequence in each run after the warm-up."""
    for name in experiment.sequences:
        dataset = open_dataset(experiment.recording(name).folder)
        for run in range(1 + RUNS):
            experiment.report(f"{name}, run {run} of {RUNS}")
            frames = experiment.frames if run else WARM_UP_FRAMES
            rates = {method: frame_rate(*setup, dataset, frames) for method, setup in SETUPS.items()}
            yield from ({"sequence": name, "method": method, "rate": rate} for method, rate in rates.items() if run)


def frame_rate(create: Callable[[Intrinsics], Any], how: str, dataset: Dataset, frames: int) -> float:
    """Return the throughput of a new corrector on the first frames of a dataset, reading included [frames/s].

    Args:
        create: Makes the corrector for a camera.
        how: `PIPELINED` for the two stages side by side; otherwise one frame after the other.
        dataset: The frames.
        frames: Number of them that are corrected.
    """
    corrector, read = create(dataset.intrinsics), (dataset[index] for index in range(frames))
    start = time.perf_counter()
    for _ in CorrectionPipeline(corrector, read) if how == PIPELINED else map(corrector.process, read):
        pass
    return frames / (time.perf_counter() - start)


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claims about the gain of the pipeline, and about the order of the methods."""
    medians = pivot(table, "method", "sequence", MEDIAN)
    gain = 100 * (medians.loc["VD"] / medians.loc["VD-Nopipe"] - 1)
    orders = {name: ", ".join(of[["RS", "VD", "GS"]].sort_values()[::-1].index) for name, of in medians.items()}
    return (
        Claim(
            "pipelining makes it 21 % faster (26.71 and 21.91 frames/s: 21.9 %), and 26.7 frames/s exceed 20",
            f"{listed(gain, '+.1f', '%')}; {listed(medians.loc['VD'], '.1f', 'frames/s')}",
            all(alike(of, PIPELINED_PERCENT) for of in gain) and bool((medians.loc["VD"] >= TARGET).all()),
            f"{WITHIN}, and there are {TARGET:g} frames/s, in every sequence",
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
