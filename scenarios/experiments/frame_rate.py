"""Table fps: frames per second from files, pipelined and not, beside the paper's other methods."""

import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

from voxdepth.corrector import PaperVoxDepth
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.paper.config import PaperConfig
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.registry import create_corrector
from voxdepth.types import DepthCorrector, Intrinsics

from ..benchmark.frames import write_tum
from ..benchmark.throughput import read
from .drawing import labelled, panels
from .paper import FRAMES_PER_S
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IMAGES = 16
"""Distinct frames on disk, which are read forwards and backwards."""
ROUNDS = 3
"""Runs of each way, in turns, so that what slows the machine meanwhile slows all of them."""
WARM_UP_FRAMES = 16
TARGET = 20.0
"""The paper's: frames per second."""
PIPELINED, ALONE = "VD", "VD-Nopipe"

Run = Callable[[DepthCorrector, Dataset, int], None]
"""Corrects that many frames."""
Make = Callable[[Intrinsics], DepthCorrector]


def _voxdepth(lag: int) -> Make:
    return lambda intrinsics: PaperVoxDepth(intrinsics, PaperConfig(fusion_lag_frames=lag))


def _peer(name: str) -> Make:
    return lambda intrinsics: create_corrector(name, intrinsics)


def one_by_one(corrector: DepthCorrector, dataset: Dataset, frames: int) -> None:
    """Read a frame, correct it, and only then read the next."""
    for _, frame in zip(range(frames), read(dataset), strict=False):
        corrector.process(frame)


def pipelined(corrector: DepthCorrector, dataset: Dataset, frames: int) -> None:
    """Reading, registering and combining in threads."""
    first = (frame for _, frame in zip(range(frames), read(dataset), strict=False))
    with CorrectionPipeline(corrector, first) as pipeline:
        for _ in pipeline:
            pass


WAYS: Mapping[str, tuple[str, Run, Make]] = {
    PIPELINED: ("three stages in threads, fusing beside", pipelined, _voxdepth(3)),
    ALONE: ("one by one, fusing stops all", one_by_one, _voxdepth(0)),
    "VD-Nopipe, fusing beside": ("one by one, fusing beside", one_by_one, _voxdepth(3)),
    "RS": ("one by one", one_by_one, _peer("realsense-left")),
    "GS": ("one by one", one_by_one, _peer("lmeds")),
}
"""What is done, how, and by what."""


class FrameRate:
    """The same frames from files through every method."""

    name = "fps"
    question = "How many frames per second does each method correct, reading included (Table fps)?"
    scope = Scope(sequences=("sim-LN",), frames=100, width_px=640, least_frames=WARM_UP_FRAMES)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        rates = {name: self._rates(stage, name) for name in stage.sequences}
        columns = (
            Column(name="sequence"),
            Column(name="method"),
            Column(name="how"),
            Column(name="median", unit="frames/s", places=1),
            Column(name="lowest", unit="frames/s", places=1),
            Column(name="highest", unit="frames/s", places=1),
            Column(name="n runs", places=0),
            Column(name="n frames a run", places=0),
            Column(name="paper, Jetson Nano", unit="frames/s"),
        )
        rows = [
            (name, way, WAYS[way][0], median(found), min(found), max(found), len(found), stage.frames,
             FRAMES_PER_S.get(way))
            for name, by_way in rates.items()
            for way, found in by_way.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of("Frames per second from files", columns, rows),),
            claims=(*(_of_pipeline(name, found) for name, found in rates.items()), _of_order(rates)),
            notes=(
                f"{IMAGES} images of each sequence as PNG files, played forwards and backwards; OpenCV on one thread, "
                f"after a warm-up, {ROUNDS} runs of each in turns.",
                "VD runs in three threads and one that fuses, all others in one and where told one that fuses: on "
                "few processors there is little to overlap. The paper's kernels ran on the GPU of a Jetson Nano.",
                "DeepSmooth (2 frames/s in the paper) is not built here. GS is our reconstruction in NumPy.",
            ),
            figure=panels(f"Frame rates, n = {ROUNDS} runs of {stage.frames} frames", partial(_draw, rates)),
        )

    def _rates(self, stage: Stage, name: str) -> dict[str, list[float]]:
        """Frames per second of every run, by way."""
        clip = stage.clip(name, IMAGES)
        rates: dict[str, list[float]] = {way: [] for way in WAYS}
        with tempfile.TemporaryDirectory(prefix="voxdepth-fps-") as folder:
            write_tum(clip, Path(folder) / "tum", stage.frames)
            dataset = open_dataset(Path(folder) / "tum", "tum")
            for _, run, make in WAYS.values():
                _timed(run, make, dataset, WARM_UP_FRAMES)
            for turn in range(ROUNDS):
                for way, (_, run, make) in WAYS.items():
                    stage.tell(f"{name}, {way}, run {turn + 1} of {ROUNDS}")
                    rates[way].append(stage.frames / _timed(run, make, dataset, stage.frames))
        return rates


def _timed(run: Run, make: Make, dataset: Dataset, frames: int) -> float:
    """Wall-clock time of a run with a new corrector [s]."""
    corrector = make(dataset.intrinsics)
    start = time.perf_counter()
    run(corrector, dataset, frames)
    time_s = time.perf_counter() - start
    close = getattr(corrector, "close", None)
    if close is not None:
        close()
    return time_s


def _of_pipeline(name: str, rates: Mapping[str, list[float]]) -> Claim:
    speed_up = 100 * (median(rates[PIPELINED]) / median(rates[ALONE]) - 1)
    return Claim(
        paper="pipelining makes it 21 % faster (26.71 and 21.91 frames/s: 21.9 %), and 26.7 frames/s exceed 20",
        found=f"{name}: {speed_up:+.1f} %, {median(rates[PIPELINED]):.1f} frames/s",
        holds=speed_up > 0 and median(rates[PIPELINED]) >= TARGET,
    )


def _of_order(rates: Mapping[str, Mapping[str, list[float]]]) -> Claim:
    orders = {}
    for name, by_way in rates.items():
        medians = {way: median(by_way[way]) for way in ("VD", "RS", "GS")}
        orders[name] = sorted(medians, key=lambda way: -medians[way])
    told = "; ".join(f"{name} {', '.join(order)}" for name, order in orders.items())
    return Claim(
        paper="RS is faster than VD, and VD than GS (39.52, 26.71 and 16.89 frames/s)",
        found=f"from fast to slow: {told}",
        holds=all(order == ["RS", "VD", "GS"] for order in orders.values()),
    )


def _draw(rates: Mapping[str, Mapping[str, list[float]]], axes: "Axes") -> None:
    for k, (name, by_way) in enumerate(rates.items()):
        values = [median(found) for found in by_way.values()]
        spread = [[value - min(found) for value, found in zip(values, by_way.values(), strict=True)],
                  [max(found) - value for value, found in zip(values, by_way.values(), strict=True)]]  # fmt: skip
        places = [place + 0.4 * (k / len(rates)) for place in range(len(by_way))]
        axes.bar(places, values, 0.4 / len(rates), yerr=spread, capsize=3, label=name)
    printed = [FRAMES_PER_S.get(way, 0.0) for way in WAYS]
    axes.bar([place - 0.3 for place in range(len(WAYS))], printed, 0.2, color="0.7", label="paper, Jetson Nano")
    axes.axhline(TARGET, color="0.4", ls="--", lw=1, label="target")
    axes.set_xticks(range(len(WAYS)), [way.replace(", ", ",\n") for way in WAYS], fontsize=7)
    labelled(axes, "median; bars from lowest to highest", "method", "frames per second")
    axes.legend(fontsize=7)
