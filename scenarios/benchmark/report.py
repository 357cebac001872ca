"""Printed tables of the benchmark."""

from collections.abc import Iterator, Mapping, Sequence

from rich.console import Console

from ..results.provenance import Provenance
from ..results.table import Column, Table, Value
from .libraries import STEPS, fastest
from .memory import Memory
from .suite import BenchmarkResults, fit_line
from .throughput import Throughput
from .timings import DefaultTimings, Latency, PaperTimings

REGISTRATION = ("describe", "register")
"""Steps that are printed as parts of the registration."""
PERCENTILES = tuple(Column(name, "ms") for name in ("p50", "p95", "p99", "max"))


def print_results(console: Console, results: BenchmarkResults) -> None:
    """Print the machine and a table for each measurement that was made."""
    for line in _machine(results.provenance):
        console.print(line, soft_wrap=True, highlight=False)
    for default in results.default:
        _print(console, *_default(default))
    size = results.paper.size
    _print(console, *_paper(results.paper))
    _print(console, _libraries(results.libraries, size))
    if results.sizes:
        _print(console, *_sizes(results.sizes))
    if results.throughput:
        _print(console, *_throughput(results.throughput, size))
    if results.memory:
        _print(console, _memory(results.memory))


def _print(console: Console, table: Table, remark: str = "") -> None:
    table.print(console)
    if remark:
        console.print(remark, soft_wrap=True, highlight=False)


def _machine(provenance: Provenance) -> Iterator[str]:
    processors = f"{provenance.logical_processors} processors"
    yield f"machine: {provenance.processor}, {processors}, Python {provenance.python}"
    yield f"GPU: {', '.join(provenance.gpus) or 'none'}"
    yield f"load in the last minute, before: {provenance.load:.1f}"
    yield f"versions: {', '.join(f'{name} {version}' for name, version in provenance.versions.items())}"


def _default(timings: DefaultTimings) -> tuple[Table, str]:
    rows = [_row(step, latency) for step, latency in timings.steps.items()] + [_row("whole frame", timings.frame)]
    table = Table.of(f"voxdepth, {timings.size}, one core", ("step", *PERCENTILES), rows)
    tracked = timings.frame.n - timings.lost_frames
    return table, f"{timings.frame.n} frames were measured; in {tracked} the camera was found"


def _paper(timings: PaperTimings) -> tuple[Table, str]:
    rows = []
    for step, latency in timings.steps.items():
        rows.append(_row(f"registration, {step}" if step in REGISTRATION else step, latency))
        if step == "filter":
            rows.append(_row("correction state, sum of the above", timings.correction))
    rows.append(_row("frame without fusion", timings.frame))
    rows += [_row(f"fusion, {step}", latency) for step, latency in timings.fusion_steps.items()]
    rows.append(_row("fusion of 10 frames", timings.fusion))
    table = Table.of(f"paper, {timings.size}, one core", ("step", *PERCENTILES), rows)
    return table, f"{timings.correction.n} frames and {timings.fusion.n} fusions were measured"


def _libraries(libraries: Mapping[str, Mapping[str, Latency]], size: str) -> Table:
    columns = [Column("step"), *(Column(library, "ms") for library in libraries), Column("fastest")]
    rows: list[Sequence[Value]] = [
        (step, *(times[step].p50_ms for times in libraries.values()), fastest(libraries, step)) for step in STEPS
    ]
    return Table.of(f"paper, {size}, median of a step by library", columns, rows)


def _sizes(sizes: Sequence[PaperTimings]) -> tuple[Table, str]:
    start_ms, pixel_ns = fit_line([one.pixels for one in sizes], [one.correction.p50_ms for one in sizes])
    columns = ("size", Column("correction state", "ms"), Column("per pixel", "ns", ".1f"), Column("line", "ms"),
               Column("fusion", "ms", ".1f"))  # fmt: skip
    rows = [
        (one.size, one.correction.p50_ms, 1e6 * one.correction.p50_ms / one.pixels,
         start_ms + 1e-6 * pixel_ns * one.pixels, one.fusion.p50_ms)
        for one in sizes
    ]  # fmt: skip
    remark = f"line: {start_ms:.2f} ms a frame and {pixel_ns:.1f} ns a pixel"
    return Table.of("paper, medians by image size", columns, rows), remark


def _throughput(runs: Sequence[Throughput], size: str) -> tuple[Table, str]:
    times = (Column(name, "ms", ".1f") for name in ("p50", "p99", "max"))
    rate = Column("throughput", "frames/s", ".1f")
    columns = [Column("mode"), Column("lag"), rate, Column("ratio"), *times, Column("fused windows")]
    rows = [
        (run.mode, run.lag, run.frames_per_s, run.frames_per_s / runs[0].frames_per_s,
         run.latency.p50_ms, run.latency.p99_ms, run.latency.max_ms, run.windows)
        for run in runs
    ]  # fmt: skip
    remark = "times: from the end of reading to delivery; fused windows: those that became templates"
    return Table.of(f"paper, {runs[0].frames} frames of {size} from files", columns, rows), remark


def _memory(memory: Sequence[Memory]) -> Table:
    values = (Column(name, "MB", ".0f") for name in ("libraries", "frames kept", "peak of correcting"))
    columns = [Column("corrector and size"), *values]
    rows = [(f"{one.corrector}, {one.size}", one.libraries_mb, one.frames_mb, one.correcting_mb) for one in memory]
    return Table.of("resident memory", columns, rows)


def _row(step: str, latency: Latency) -> Sequence[Value]:
    return step, latency.p50_ms, latency.p95_ms, latency.p99_ms, latency.max_ms
