"""Frames per second of the paper's corrector from files, one by one and in a pipeline, and how long a frame takes."""

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2

from voxdepth.corrector import VoxDepth
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.model import Model
from voxdepth.paper.config import PaperConfig
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.types import Frame

from .clip import Clip
from .spread import Spread
from .tum import write_tum
from .watched import Watched


class Throughput(Model):
    """How fast a run through a folder of frames was."""

    way: str
    """`one by one` or `pipelined`."""
    lag: int | str
    """`fusion_lag_frames`; without one, fusing stops everything else."""
    frames: int
    frames_per_s: float
    """Reading included."""
    windows: int
    """Windows that were fused and came into force."""
    latency: Spread
    """From the end of reading a frame to its delivery."""


Run = Callable[[Watched, Dataset], list[float]]
"""Corrects all frames; gives their latencies [s]."""


def compare_runs(clip: Clip, frames: int) -> list[Throughput]:
    """The same frames one by one and pipelined, with different lags; the first run does one thing at a time."""
    cv2.setNumThreads(1)
    alone, default, ready = (
        PaperConfig(fusion_lag_frames=0),
        PaperConfig(),
        PaperConfig(fusion_lag_frames="ready"),
    )
    with tempfile.TemporaryDirectory(prefix="voxdepth-bench-") as folder:
        write_tum(clip, Path(folder) / "tum", frames)
        dataset = open_dataset(Path(folder) / "tum", "tum")
        return [
            *(measure_run("one by one", one_by_one, dataset, config) for config in (alone, default)),
            *(measure_run("pipelined", pipelined, dataset, config) for config in (default, ready)),
        ]


def measure_run(way: str, run: Run, dataset: Dataset, config: PaperConfig) -> Throughput:
    """Run a new corrector through all frames."""
    corrector = Watched(VoxDepth(dataset.intrinsics, config))
    start = time.perf_counter()
    latencies_s = run(corrector, dataset)
    wall_s = time.perf_counter() - start
    corrector.close()
    return Throughput(
        way=way,
        lag=config.fusion_lag_frames,
        frames=len(latencies_s),
        frames_per_s=len(latencies_s) / wall_s,
        windows=len(corrector.fusions_s),
        latency=Spread.of(latencies_s),
    )


def one_by_one(corrector: Watched, dataset: Dataset) -> list[float]:
    """Read a frame, correct it, and only then read the next."""
    latencies_s = []
    for frame in read(dataset):
        start = time.perf_counter()
        corrector.process(frame)
        latencies_s.append(time.perf_counter() - start)
    return latencies_s


def pipelined(corrector: Watched, dataset: Dataset) -> list[float]:
    """Reading, registering and combining in threads."""
    with CorrectionPipeline(corrector, read(dataset)) as pipeline:
        for _ in pipeline:
            pass
        return pipeline.latencies_s


def read(dataset: Dataset) -> Iterator[Frame]:
    """All frames, each when it is asked for."""
    return (dataset[index] for index in range(len(dataset)))
