"""The benchmark: all measurements, one after the other."""

from collections.abc import Callable

import numpy as np
from pydantic import Field

from voxdepth.model import Model

from ..errors import ScenarioError
from ..results.provenance import CORRECTION, Provenance
from .frames import SIZE_PX, FrameLoop
from .libraries import compare_libraries
from .memory import CORRECTORS, Memory, measure_memory
from .throughput import Throughput, compare_runs
from .timings import DefaultTimings, Latency, PaperTimings, measure_default, measure_paper

N_FRAMES = 300
"""Frames of the step timings; the paper's method fuses ten windows of them."""
SIZES_PX = ((160, 120), (320, 240), (640, 360), (640, 480), (1280, 720), (1920, 1080))
N_FRAMES_PER_SIZE = 100
N_FRAMES_FROM_FILES = 500
LARGE_PX = (1024, 1024)
"""Second size at which the default corrector and memory are measured."""
SIDES_PX = range(32, 4097)
"""Valid widths and heights of the images."""

Report = Callable[[str], None]
"""Is called with a description of each measurement when it begins."""


class BenchmarkResults(Model):
    """All measurements; those that were left out or are impossible here are empty."""

    provenance: Provenance
    default: list[DefaultTimings]
    """Latency of the default corrector by size."""
    paper: PaperTimings
    """Latency of the paper's method."""
    libraries: dict[str, dict[str, Latency]]
    """Times of every step by library."""
    sizes: list[PaperTimings] = Field(default_factory=list)
    throughput: list[Throughput] = Field(default_factory=list)
    memory: list[Memory] = Field(default_factory=list)


def valid_size(width_px: int | None, height_px: int | None) -> tuple[int, int]:
    """Width and height of the images; those of the rendered images where none are given.

    Raises:
        ScenarioError: A side is too short or too long.
    """
    width_px = SIZE_PX[0] if width_px is None else width_px
    height_px = SIZE_PX[1] if height_px is None else height_px
    if width_px not in SIDES_PX or height_px not in SIDES_PX:
        raise ScenarioError(
            f"--size must have {SIDES_PX.start} to {SIDES_PX.stop - 1} pixels on each side, got {width_px}x{height_px}"
        )
    return width_px, height_px


def measure_quickly(loop: FrameLoop, report: Report) -> BenchmarkResults:
    """Measure what takes seconds: the steps of both correctors and of the libraries."""
    provenance = Provenance.here(CORRECTION)
    report(f"running the steps on {loop.size} with each library; kernels are compiled on their first use")
    libraries = compare_libraries(loop)
    report(f"correcting {N_FRAMES} frames of {loop.size} with each corrector")
    default, paper = measure_default(loop, N_FRAMES), measure_paper(loop, N_FRAMES)
    return BenchmarkResults(provenance=provenance, default=[default], paper=paper, libraries=libraries)


def measure_rest(quick: BenchmarkResults, loop: FrameLoop, report: Report) -> BenchmarkResults:
    """Add to the quick results what takes a minute: other sizes, throughput from files, and memory."""
    large = loop.resized(*LARGE_PX)
    report(f"correcting {N_FRAMES_PER_SIZE} frames of {large.size}")
    default = [*quick.default, measure_default(large, N_FRAMES_PER_SIZE)]
    sizes = []
    for width_px, height_px in SIZES_PX:
        report(f"correcting {N_FRAMES_PER_SIZE} frames of {width_px}x{height_px}")
        sizes.append(measure_paper(loop.resized(width_px, height_px), N_FRAMES_PER_SIZE))
    report(f"correcting {N_FRAMES_FROM_FILES} frames from files, one by one and pipelined")
    throughput = compare_runs(loop, N_FRAMES_FROM_FILES)
    report("measuring memory")
    memory = [measure_memory(corrector, frames) for corrector in CORRECTORS for frames in (loop, large)]
    known = [found for found in memory if found is not None]
    return quick.model_copy(update={"default": default, "sizes": sizes, "throughput": throughput, "memory": known})


def fit_line(pixels: list[int], times_ms: list[float]) -> tuple[float, float]:
    """Fixed cost of a frame [ms] and cost of a pixel [ns]: the straight line with the least relative squared error.

    Args:
        pixels: Number of pixels per image; at least two different numbers.
        times_ms: Time per frame, positive; as many as `pixels`.
    """
    slope_ms, start_ms = np.polyfit(pixels, times_ms, 1, w=1 / np.asarray(times_ms))
    return float(start_ms), float(1e6 * slope_ms)
