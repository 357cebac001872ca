"""Throughput and latency of the paper's method on frames from files, sequential and pipelined."""

import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import cv2

from ...datasets import Dataset, open_dataset
from ...model import Model
from ...paper.config import PaperConfig
from ...pipeline import CorrectionPipeline
from ...types import DepthCorrector, Frame
from .frames import FrameLoop, write_tum
from .timings import FusionRecorder, Latency


class Throughput(Model):
    """Speed of one run through a folder of frames."""

    mode: str
    """`one by one` or `pipelined`."""
    lag: int | str
    """`fusion_lag_frames`; if it is 0, a fusion blocks the frame that completes its window."""
    frames: int
    frames_per_s: float
    """Frame rate with reading included."""
    windows: int
    """Fused windows whose template was used."""
    latency: Latency
    """Time from the end of reading a frame to its delivery."""


Run = Callable[[DepthCorrector, Iterable[Frame]], list[float]]
"""Corrects all frames and returns their latencies [s]."""


def compare_runs(loop: FrameLoop, frames: int) -> list[Throughput]:
    """Correct the same frames one by one and pipelined, with different lags; nothing overlaps in the first run."""
    cv2.setNumThreads(1)
    blocking, default, ready = PaperConfig(fusion_lag_frames=0), PaperConfig(), PaperConfig(fusion_lag_frames="ready")
    runs = [("one by one", one_by_one, blocking), ("one by one", one_by_one, default),
            ("pipelined", pipelined, default), ("pipelined", pipelined, ready)]  # fmt: skip
    with tempfile.TemporaryDirectory(prefix="voxdepth-bench-") as folder:
        write_tum(loop, Path(folder) / "tum", frames)
        dataset = open_dataset(Path(folder) / "tum", "tum")
        return [measure_run(mode, run, dataset, config) for mode, run, config in runs]


def measure_run(mode: str, run: Run, dataset: Dataset, config: PaperConfig) -> Throughput:
    """Correct all frames with a new corrector."""
    corrector = FusionRecorder(dataset.intrinsics, config)
    start = time.perf_counter()
    latencies_s = run(corrector, read(dataset))
    wall_s = time.perf_counter() - start
    corrector.close()
    return Throughput(
        mode=mode,
        lag=config.fusion_lag_frames,
        frames=len(latencies_s),
        frames_per_s=len(latencies_s) / wall_s,
        windows=len(corrector.fusions_s),
        latency=Latency.of(latencies_s),
    )


def one_by_one(corrector: DepthCorrector, frames: Iterable[Frame]) -> list[float]:
    """Read a frame, correct it, and only then read the next; return the latencies [s]."""
    latencies_s = []
    for frame in frames:
        start = time.perf_counter()
        corrector.process(frame)
        latencies_s.append(time.perf_counter() - start)
    return latencies_s


def pipelined(corrector: DepthCorrector, frames: Iterable[Frame]) -> list[float]:
    """Read, register and combine in threads; return the latencies [s]."""
    with CorrectionPipeline(corrector, frames) as pipeline:
        for _ in pipeline:
            pass
        return pipeline.latencies_s


def read(dataset: Dataset) -> Iterator[Frame]:
    """Iterate over all frames; each is read when it is requested."""
    for index in range(len(dataset)):
        yield dataset[index]
