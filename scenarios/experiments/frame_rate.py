"""Table fps: frames per second from files, pipelined and not, beside the paper's other methods."""

import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from statistics import median

import pandas as pd
from matplotlib.axes import Axes

from voxdepth import PaperVoxDepth
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.networks import has_runtime
from voxdepth.paper.config import PaperConfig
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.registry import create_corrector
from voxdepth.tools.table import Column, Table
from voxdepth.types import DepthCorrector, Frame, Intrinsics

from ..results.figure import grouped_bars, label_axes, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .paper_results import FRAMES_PER_S, percentages_table

REPETITIONS = 3
"""Runs of each setup, which alternate, so that other load slows all of them."""
WARM_UP_FRAMES = 16
TARGET = 20.0
"""The paper's target [frames/s]."""
PIPELINED, SEQUENTIAL = "VD", "VD-Nopipe"
COLUMNS = (
    "sequence", "method", "how", Column("median", "frames/s", ".1f"), Column("lowest", "frames/s", ".1f"),
    Column("highest", "frames/s", ".1f"), "n runs", "n frames a run", Column("paper, Jetson Nano", "frames/s"),
)  # fmt: skip


@dataclass(frozen=True)
class Setup:
    """A corrector and the way that it is run."""

    how: str
    run: Callable[[DepthCorrector, Iterable[Frame]], None]
    create: Callable[[Intrinsics], DepthCorrector]

    def frame_rate(self, dataset: Dataset, frames: int) -> float:
        """Throughput of a new corrector on the first frames of a dataset [frames/s]."""
        corrector = self.create(dataset.intrinsics)
        start = time.perf_counter()
        self.run(corrector, (dataset[index] for index in range(frames)))
        time_s = time.perf_counter() - start
        close_corrector(corrector)
        return frames / time_s


def close_corrector(corrector: DepthCorrector) -> None:
    """Wait for the background work of a corrector that has any."""
    getattr(corrector, "close", lambda: None)()


def one_by_one(corrector: DepthCorrector, frames: Iterable[Frame]) -> None:
    """Read a frame, correct it, and only then read the next."""
    for frame in frames:
        corrector.process(frame)


def pipelined(corrector: DepthCorrector, frames: Iterable[Frame]) -> None:
    """Read, register and combine in threads."""
    with CorrectionPipeline(corrector, frames) as pipeline:
        for _ in pipeline:
            pass


BLOCKING, LAGGING = (partial(PaperVoxDepth, config=PaperConfig(fusion_lag_frames=lag)) for lag in (0, 3))
SETUPS: Mapping[str, Setup] = {
    PIPELINED: Setup("three stages in threads, fusing beside", pipelined, LAGGING),
    SEQUENTIAL: Setup("one by one, fusing stops all", one_by_one, BLOCKING),
    "VD-Nopipe, fusing beside": Setup("one by one, fusing beside", one_by_one, LAGGING),
    "RS": Setup("one by one", one_by_one, partial(create_corrector, "realsense-left")),
    "GS": Setup("one by one", one_by_one, partial(create_corrector, "lmeds")),
    **({"DS": Setup("one by one", one_by_one, partial(create_corrector, "learned"))} if has_runtime() else {}),
}


def compare_frame_rates(context: ExperimentContext) -> Findings:
    """Time every setup on frames from files."""
    rows = [
        (name, setup, SETUPS[setup].how, median(rates), min(rates), max(rates), len(rates), context.frames,
         FRAMES_PER_S.get(setup))
        for name in context.sequences
        for setup, rates in _measure(context, name).items()
    ]  # fmt: skip
    table = Table.of("Frames per second from files", COLUMNS, rows)
    medians = table.pivot("method", "sequence", "median")
    title = f"Frame rates, n = {REPETITIONS} runs of {context.frames} frames"
    return Findings(
        tables=(table, percentages_table("fps")),
        claims=(*(_pipeline_claim(name, medians[name]) for name in context.sequences), _order_claim(medians)),
        notes=(
            "The frames of the recording as it lies on disk, gray as PNG and depth as TIFF; OpenCV on one thread, "
            f"after a warm-up, {REPETITIONS} alternating runs of each.",
            "VD runs in three threads and one that fuses, all others in one and, where stated, one that fuses: on "
            "few processors there is little to overlap. The paper's kernels ran on the GPU of a Jetson Nano.",
            "DS is our corrector learned in ONNX Runtime, and not the paper's network; it needs the extra learned. GS "
            "is our reconstruction in NumPy.",
        ),
        figure=panels(title, [partial(_draw, table)]),
    )


def _measure(context: ExperimentContext, name: str) -> dict[str, list[float]]:
    """Frames per second of every run by setup."""
    dataset = open_dataset(context.recording(name).folder, "recording")
    rates: dict[str, list[float]] = {setup: [] for setup in SETUPS}
    for setup in SETUPS.values():
        setup.frame_rate(dataset, WARM_UP_FRAMES)
    for repetition in range(REPETITIONS):
        for key, setup in SETUPS.items():
            context.report(f"{name}, {key}, run {repetition + 1} of {REPETITIONS}")
            rates[key].append(setup.frame_rate(dataset, context.frames))
    return rates


def _pipeline_claim(name: str, medians: pd.Series) -> Claim:
    speed_up = float(100 * (medians[PIPELINED] / medians[SEQUENTIAL] - 1))
    return Claim(
        paper="pipelining makes it 21 % faster (26.71 and 21.91 frames/s: 21.9 %), and 26.7 frames/s exceed 20",
        found=f"{name}: {speed_up:+.1f} %, {medians[PIPELINED]:.1f} frames/s",
        holds=bool(speed_up > 0 and medians[PIPELINED] >= TARGET),
    )


def _order_claim(medians: pd.DataFrame) -> Claim:
    methods = medians.loc[["VD", "RS", "GS"]]
    orders = {name: list(methods[name].sort_values(ascending=False, kind="stable").index) for name in methods}
    found = "; ".join(f"{name} {', '.join(order)}" for name, order in orders.items())
    return Claim(
        paper="RS is faster than VD, and VD than GS (39.52, 26.71 and 16.89 frames/s)",
        found=f"from fast to slow: {found}",
        holds=all(order == ["RS", "VD", "GS"] for order in orders.values()),
    )


def _draw(table: Table, axes: Axes) -> None:
    paper = "paper, Jetson Nano"
    medians, lowest, highest = (table.pivot("method", "sequence", name) for name in ("median", "lowest", "highest"))
    errors = {name: [medians[name] - lowest[name], highest[name] - medians[name]] for name in medians}
    axes.axhline(TARGET, color="0.4", ls="--", lw=1, label="target")
    label_axes(axes, "median; bars from lowest to highest", "method", "frames per second")
    names = [setup.replace(", ", ",\n") for setup in SETUPS]
    series = {paper: [FRAMES_PER_S.get(setup) for setup in SETUPS], **medians.to_dict("list")}
    grouped_bars(axes, names, series, colors={paper: "0.7"}, errors=errors)


FRAME_RATE = Experiment(
    "fps", "How many frames per second does each method correct, reading included (Table fps)?",
    compare_frame_rates, ("sim-LN",), frames=100, width_px=640, min_frames=WARM_UP_FRAMES,
)  # fmt: skip
