"""The benchmark: all measurements, one after the other, and their printed tables."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from pydantic import Field
from rich.console import Console

from ...model import Model
from ..errors import ToolError
from ..provenance import CORRECTION, Provenance
from ..table import Column, Table, Value
from .frames import FrameLoop
from .librealsense import Comparison, compare_with_librealsense
from .memory import CORRECTORS, Memory, measure_memory
from .throughput import Throughput, compare_runs
from .timings import (
    OPERATIONS,
    DefaultTimings,
    Latency,
    PaperTimings,
    compare_libraries,
    fastest,
    measure_default,
    measure_paper,
)

N_FRAMES = 300
"""Frames of the step timings; the paper's method fuses ten windows of them."""
SIZES_PX = ((160, 120), (320, 240), (640, 360), (640, 480), (1280, 720), (1920, 1080))
N_FRAMES_PER_SIZE = 100
N_FRAMES_FROM_FILES = 500
LARGE_PX = (1024, 1024)
"""Second size at which the default corrector and memory are measured."""
SIDES_PX = range(32, 4097)
"""Valid widths and heights of the images."""

REGISTRATION = ("describe", "register")
"""Steps that are printed as parts of the registration."""
PERCENTILES = tuple(Column(name, "ms") for name in ("p50", "p95", "p99", "max"))

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
    """Times of every step by library; only the CPU's without Warp."""
    librealsense: list[Comparison] = Field(default_factory=list)
    """Both correctors beside librealsense, by size; empty where it is not installed."""
    sizes: list[PaperTimings] = Field(default_factory=list)
    throughput: list[Throughput] = Field(default_factory=list)
    memory: list[Memory] = Field(default_factory=list)


def require_valid_size(width_px: int, height_px: int) -> None:
    """Raise a `ToolError` for images with a side that is too short or too long."""
    if width_px not in SIDES_PX or height_px not in SIDES_PX:
        raise ToolError(
            f"--size must have {SIDES_PX.start} to {SIDES_PX.stop - 1} pixels on each side, got {width_px}x{height_px}"
        )


def measure_quickly(loop: FrameLoop, report: Report) -> BenchmarkResults:
    """Measure what takes seconds: the steps of both correctors and of the libraries."""
    provenance = Provenance.here(CORRECTION)
    report(f"running the steps on {loop.size} with each library; kernels are compiled on their first use")
    libraries = compare_libraries(loop)
    report(f"correcting {N_FRAMES} frames of {loop.size} with each corrector")
    default, paper = measure_default(loop, N_FRAMES), measure_paper(loop, N_FRAMES)
    report(f"correcting {N_FRAMES} frames of {loop.size} with librealsense and with each corrector in turn")
    compared = compare_with_librealsense(loop, N_FRAMES)
    librealsense = [] if compared is None else [compared]
    return BenchmarkResults(
        provenance=provenance, default=[default], paper=paper, libraries=libraries, librealsense=librealsense
    )


def measure_rest(quick: BenchmarkResults, loop: FrameLoop, report: Report) -> BenchmarkResults:
    """Add to the quick results what takes a minute: other sizes, throughput from files, and memory."""
    large = loop.resized(*LARGE_PX)
    report(f"correcting {N_FRAMES_PER_SIZE} frames of {large.size}")
    default = [*quick.default, measure_default(large, N_FRAMES_PER_SIZE)]
    compared = compare_with_librealsense(large, N_FRAMES_PER_SIZE)
    librealsense = [*quick.librealsense, *([] if compared is None else [compared])]
    sizes = []
    for width_px, height_px in SIZES_PX:
        report(f"correcting {N_FRAMES_PER_SIZE} frames of {width_px}x{height_px}")
        sizes.append(measure_paper(loop.resized(width_px, height_px), N_FRAMES_PER_SIZE))
    report(f"correcting {N_FRAMES_FROM_FILES} frames from files, one by one and pipelined")
    throughput = compare_runs(loop, N_FRAMES_FROM_FILES)
    report("measuring memory")
    memory = [measure_memory(corrector, frames) for corrector in CORRECTORS for frames in (loop, large)]
    known = [found for found in memory if found is not None]
    rest = {"default": default, "librealsense": librealsense, "sizes": sizes, "throughput": throughput, "memory": known}
    return quick.model_copy(update=rest)


def fit_line(pixels: list[int], times_ms: list[float]) -> tuple[float, float]:
    """Fixed cost of a frame [ms] and cost of a pixel [ns]: the straight line with the least relative squared error.

    There must be as many positive times as numbers of pixels, at least two of which differ.
    """
    slope_ms, start_ms = np.polyfit(pixels, times_ms, 1, w=1 / np.asarray(times_ms))
    return float(start_ms), float(1e6 * slope_ms)


def print_results(console: Console, results: BenchmarkResults) -> None:
    """Print the machine and a table for each measurement that was made."""
    made, size = results.provenance, results.paper.size
    versions = ", ".join(f"{name} {version}" for name, version in made.versions.items())
    machine = [
        f"machine: {made.processor}, {made.logical_processors} processors, Python {made.python}",
        f"GPU: {', '.join(made.gpus) or 'none'}",
        f"load in the last minute, before: {'unknown' if made.load is None else format(made.load, '.1f')}",
        f"versions: {versions}",
    ]
    console.print(*machine, sep="\n", soft_wrap=True, highlight=False)
    tables = [
        *map(_librealsense, results.librealsense),
        *map(_default, results.default),
        _paper(results.paper),
    ]
    if len(results.libraries) > 1:
        tables.append(_libraries(results.libraries, size))
    if results.sizes:
        tables.append(_sizes(results.sizes))
    if results.throughput:
        tables.append(_throughput(results.throughput, size))
    if results.memory:
        tables.append(_memory(results.memory))
    for table in tables:
        table.print(console)
        if table.note:
            console.print(table.note, soft_wrap=True, highlight=False)


def _librealsense(compared: Comparison) -> Table:
    rows = [(*_row(name, latency), compared.ratio(name)) for name, latency in compared.latencies.items()]
    note = "librealsense: its recommended filters; ratio: of the medians"
    title = f"correctors beside librealsense, {compared.size}, one core, each frame in turn"
    return Table.of(title, ("method", *PERCENTILES, "ratio"), rows, note=note)


def _default(timings: DefaultTimings) -> Table:
    rows = [_row(step, latency) for step, latency in timings.steps.items()] + [_row("whole frame", timings.frame)]
    tracked = timings.frame.n - timings.lost_frames
    note = f"{timings.frame.n} frames were measured; in {tracked} the camera was found"
    return Table.of(f"voxdepth, {timings.size}, one core", ("step", *PERCENTILES), rows, note=note)


def _paper(timings: PaperTimings) -> Table:
    rows = []
    for step, latency in timings.steps.items():
        rows.append(_row(f"registration, {step}" if step in REGISTRATION else step, latency))
        if step == "filter":
            rows.append(_row("correction state, sum of the above", timings.correction))
    rows.append(_row("frame without fusion", timings.frame))
    rows += [_row(f"fusion, {step}", latency) for step, latency in timings.fusion_steps.items()]
    rows.append(_row("fusion of 10 frames", timings.fusion))
    note = f"{timings.correction.n} frames and {timings.fusion.n} fusions were measured"
    return Table.of(f"paper, {timings.size}, one core", ("step", *PERCENTILES), rows, note=note)


def _libraries(libraries: Mapping[str, Mapping[str, Latency]], size: str) -> Table:
    columns: list[Column | str] = ["step", *(Column(library, "ms") for library in libraries), "fastest"]
    rows: list[Sequence[Value]] = [
        (step, *(times[step].p50_ms for times in libraries.values()), fastest(libraries, step)) for step in OPERATIONS
    ]
    return Table.of(f"paper, {size}, median of a step by library", columns, rows)


def _sizes(sizes: Sequence[PaperTimings]) -> Table:
    start_ms, pixel_ns = fit_line([one.pixels for one in sizes], [one.correction.p50_ms for one in sizes])
    columns = ("size", Column("correction state", "ms"), Column("per pixel", "ns", ".1f"), Column("line", "ms"),
               Column("fusion", "ms", ".1f"))  # fmt: skip
    rows = [
        (one.size, one.correction.p50_ms, 1e6 * one.correction.p50_ms / one.pixels,
         start_ms + 1e-6 * pixel_ns * one.pixels, one.fusion.p50_ms)
        for one in sizes
    ]  # fmt: skip
    note = f"line: {start_ms:.2f} ms a frame and {pixel_ns:.1f} ns a pixel"
    return Table.of("paper, medians by image size", columns, rows, note=note)


def _throughput(runs: Sequence[Throughput], size: str) -> Table:
    times = (Column(name, "ms", ".1f") for name in ("p50", "p99", "max"))
    rate = Column("throughput", "frames/s", ".1f")
    columns: list[Column | str] = ["mode", "lag", rate, "ratio", *times, "fused windows"]
    rows = [
        (run.mode, run.lag, run.frames_per_s, run.frames_per_s / runs[0].frames_per_s,
         run.latency.p50_ms, run.latency.p99_ms, run.latency.max_ms, run.windows)
        for run in runs
    ]  # fmt: skip
    note = "times: from the end of reading to delivery; fused windows: those that became templates"
    return Table.of(f"paper, {runs[0].frames} frames of {size} from files", columns, rows, note=note)


def _memory(memory: Sequence[Memory]) -> Table:
    values = (Column(name, "MB", ".0f") for name in ("libraries", "frames kept", "peak of correcting"))
    rows = [(f"{one.corrector}, {one.size}", one.libraries_mb, one.frames_mb, one.correcting_mb) for one in memory]
    return Table.of("resident memory", ["corrector and size", *values], rows)


def _row(step: str, latency: Latency) -> Sequence[Value]:
    return step, latency.p50_ms, latency.p95_ms, latency.p99_ms, latency.max_ms
