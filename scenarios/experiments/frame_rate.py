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

from .experiment import WITHIN, Claim, ExperimentContext, Findings, alike, asks, listed, pivot
from .paper_results import FRAMES_PER_S, SWARM

RUNS, WARM_UP_FRAMES = 3, 16
"""Runs of each setup, which alternate, so that other load slows all of them; and frames of one more before these."""
PIPELINED_PERCENT = 21.9
"""By how much pipelining makes the paper's method faster, by its table [%]."""
TARGET = 20.0
"""The paper's target [frames/s]."""
MEDIAN, PAPER = "median [frames/s]", "paper, Jetson Nano [frames/s]"
ONE_BY_ONE, PIPELINED = "one by one", "three stages in threads"
BLOCKING, LAGGING = (partial(VoxDepth, config=VoxDepthConfig(fusion_lag_frames=lag)) for lag in (0, 3))
"""Fusing stops all, or goes on beside."""
SETUPS: Mapping[str, tuple[Callable[[Intrinsics], Any], str]] = {
    "VD": (LAGGING, PIPELINED),
    "VD-Nopipe": (BLOCKING, ONE_BY_ONE),
    "VD-Nopipe, fusing beside": (LAGGING, ONE_BY_ONE),
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
    spread = rates.agg(**{MEDIAN: "median", "lowest [frames/s]": "min", "highest [frames/s]": "max"})
    everyone = pd.MultiIndex.from_product([context.sequences, [*SETUPS, SWARM]], names=["sequence", "method"])
    table = spread.reindex(everyone).reset_index()
    is_ours, hows = table[MEDIAN].notna(), {method: how for method, (_, how) in SETUPS.items()}
    table.insert(2, "how", table["method"].map(hows).fillna("not repeated here"))
    table["n runs"], table["n frames a run"] = RUNS * is_ours, context.frames * is_ours
    table[PAPER] = table["method"].map(FRAMES_PER_S)
    medians = pivot(table, "method", "sequence", MEDIAN)
    speed_up = 100 * (medians.loc["VD"] / medians.loc["VD-Nopipe"] - 1)
    orders = {name: ", ".join(of[["RS", "VD", "GS"]].sort_values()[::-1].index) for name, of in medians.items()}
    pipeline = Claim(
        "pipelining makes it 21 % faster (26.71 and 21.91 frames/s: 21.9 %), and 26.7 frames/s exceed 20",
        f"{listed(speed_up, '+.1f', '%')}; {listed(medians.loc['VD'], '.1f', 'frames/s')}",
        all(alike(of, PIPELINED_PERCENT) for of in speed_up) and bool((medians.loc["VD"] >= TARGET).all()),
        f"{WITHIN}, and there are {TARGET:g} frames/s, in every sequence",
    )
    order = Claim(
        "RS is faster than VD, and VD than GS (39.52, 26.71 and 16.89 frames/s)",
        "from fast to slow: " + "; ".join(f"{name} {order}" for name, order in orders.items()),
        set(orders.values()) == {"RS, VD, GS"},
        "it is the order in every sequence",
    )
    shown = medians.assign(**{PAPER: pd.Series(FRAMES_PER_S)})[::-1]
    return Findings(
        tables={"table": table},
        claims=(pipeline, order),
        notes=(
            "The gray PNG and the depth TIFF of each frame are read; OpenCV is on one thread. VD and VD-Nopipe, fusing "
            "beside, have one more thread that fuses. VD-code is what the code of the paper's authors does, DS our "
            "corrector learned, GS our reconstruction in NumPy; Swarm's rate is quoted by the paper.",
        ),
        figure=panels(
            f"Frame rates, median of {RUNS} runs of {context.frames} frames; the paper's target is {TARGET:g}",
            [plotted(shown, "", "frames per second", "", kind="barh")],
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
