"""Table fps: frames per second from files, pipelined and not, beside the paper's other methods."""

import time
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import pandas as pd

from voxdepth import CorrectionPipeline, VoxDepth
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.networks import has_runtime
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import AUTHORS, create_corrector
from voxdepth.tools.figure import panels, plotted
from voxdepth.types import Intrinsics

from .experiment import Claim, ExperimentContext, Findings, asks

RUNS, WARM_UP_FRAMES = 3, 16
"""Runs of each setup, which alternate, so that other load slows all of them; and frames of one more before these."""
PAPER_FRAMES_PER_S = {"VD": 26.71, "VD-Nopipe": 21.91, "RS": 39.52, "GS": 16.89, "DS": 2.0}
TARGET = 20.0
"""The paper's target [frames/s]."""
PIPELINING_PERCENT = (11.0, 44.0)
"""Gains by pipelining that agree with the 21.9 % of the paper: half to twice as much [%]."""
MEDIAN, PAPER = "median [frames/s]", "paper, Jetson Nano [frames/s]"
ONE_BY_ONE, PIPELINED = "one by one", "three stages in threads"
SETUPS: Mapping[str, tuple[Callable[[Intrinsics], Any], str]] = {
    "VD": (partial(VoxDepth, config=VoxDepthConfig(fusion_lag_frames=3)), PIPELINED),
    "VD-Nopipe": (partial(VoxDepth, config=VoxDepthConfig(fusion_lag_frames=0)), ONE_BY_ONE),
    "VD-code": (partial(create_corrector, AUTHORS), ONE_BY_ONE),
    "RS": (partial(create_corrector, "realsense-left"), ONE_BY_ONE),
    "GS": (partial(create_corrector, "lmeds"), ONE_BY_ONE),
    **({"DS": (partial(create_corrector, "learned"), ONE_BY_ONE)} if has_runtime() else {}),
}
"""A function that creates the corrector, and how it is run, by the paper's name. DS needs the extra `learned`."""


@asks(
    "How many frames per second does each method correct, reading included (Table fps)?",
    sequences=("sim-LN",), frames=100, width_px=640, min_frames=WARM_UP_FRAMES,
)  # fmt: skip
def fps(context: ExperimentContext) -> Findings:
    """Time every setup on frames from files, in alternating runs."""
    rates = pd.DataFrame(_timed(context)).groupby(["sequence", "method"], sort=False)["rate"]
    table = rates.agg(**{MEDIAN: "median", "lowest [frames/s]": "min", "highest [frames/s]": "max"}).reset_index()
    table.insert(2, "how", table["method"].map({method: how for method, (_, how) in SETUPS.items()}))
    table[PAPER] = table["method"].map(PAPER_FRAMES_PER_S)
    medians = table.pivot(index="method", columns="sequence", values=MEDIAN).loc[list(SETUPS)]
    gains = 100 * (medians.loc["VD"] / medians.loc["VD-Nopipe"] - 1)
    orders = {name: ", ".join(of[["RS", "VD", "GS"]].sort_values()[::-1].index) for name, of in medians.items()}
    found = ", ".join(f"{name} {gains[name]:+.1f} %, {medians.loc['VD', name]:.1f} frames/s" for name in medians)
    return Findings(
        table=table,
        claims=(
            Claim(
                f"pipelining makes VD 21 % faster (26.71 and 21.91 frames/s: 21.9 %), beyond {TARGET:g} frames/s",
                found,
                bool(gains.between(*PIPELINING_PERCENT).all() and (medians.loc["VD"] >= TARGET).all()),
            ),
            Claim(
                "RS is faster than VD, and VD than GS (39.52, 26.71 and 16.89 frames/s)",
                "from fast to slow: " + "; ".join(f"{name} {order}" for name, order in orders.items()),
                set(orders.values()) == {"RS, VD, GS"},
            ),
        ),
        notes=(
            f"Each rate is of {RUNS} runs of {context.frames} frames. The gray PNG and the depth TIFF of each frame "
            "are read; OpenCV is on one thread. VD has one more thread that fuses. VD-code is what the code of the "
            "paper's authors does, DS our corrector learned, GS our reconstruction in NumPy.",
        ),
        figure=panels(
            f"Frame rates, median of {RUNS} runs of {context.frames} frames; the paper's target is {TARGET:g}",
            [plotted(medians.assign(**{PAPER: PAPER_FRAMES_PER_S})[::-1], "", "frames per second", "", kind="barh")],
        ),
    )


def _timed(context: ExperimentContext) -> Iterator[dict[str, Any]]:
    """Yield the rate of every setup on every sequence in each run after the warm-up."""
    for name in context.sequences:
        dataset = open_dataset(context.recording(name).folder, "recording")
        for run in range(1 + RUNS):
            context.report(f"{name}, run {run} of {RUNS}")
            frames = context.frames if run else WARM_UP_FRAMES
            rates = {method: frame_rate(*setup, dataset, frames) for method, setup in SETUPS.items()}
            yield from ({"sequence": name, "method": method, "rate": rate} for method, rate in rates.items() if run)


def frame_rate(create: Callable[[Intrinsics], Any], how: str, dataset: Dataset, frames: int) -> float:
    """Throughput of a new corrector on the first frames of a dataset, reading included [frames/s]."""
    corrector, read = create(dataset.intrinsics), (dataset[index] for index in range(frames))
    start = time.perf_counter()
    for _ in CorrectionPipeline(corrector, read) if how == PIPELINED else map(corrector.process, read):
        pass
    time_s = time.perf_counter() - start
    corrector.close()
    return frames / time_s
