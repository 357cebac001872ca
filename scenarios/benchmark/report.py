"""The figures as tables."""

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table

from .default import DefaultParts
from .libraries import STEPS, fastest
from .machine import Machine
from .memory import Memory
from .parts import Parts
from .spread import Spread
from .suite import Figures, line_through
from .throughput import Throughput

REGISTERING = {"describe": "registration, describe", "register": "registration, register"}
"""Names of steps that say too little by themselves."""


def print_figures(console: Console, figures: Figures) -> None:
    """All that there is."""
    _print_machine(console, figures.machine)
    for default in figures.default:
        _print_default(console, default)
    _print_parts(console, figures.parts)
    _print_libraries(console, figures.libraries, figures.parts.size)
    if figures.sizes:
        _print_sizes(console, figures.sizes)
    if figures.throughput:
        _print_throughput(console, figures.throughput, figures.parts.size)
    if figures.memory:
        _print_memory(console, figures.memory)


def _print_machine(console: Console, machine: Machine) -> None:
    where = f"{machine.processor}, {machine.processors} processors, Python {machine.python}"
    console.print(f"machine: {where}", soft_wrap=True, highlight=False)
    console.print(f"GPU: {', '.join(machine.gpus) or 'none'}", soft_wrap=True, highlight=False)
    versions = ", ".join(f"{name} {version}" for name, version in machine.versions.items())
    console.print(f"load in the last minute, before: {machine.load:.1f}", highlight=False)
    console.print(f"versions: {versions}", soft_wrap=True, highlight=False)


def _print_default(console: Console, default: DefaultParts) -> None:
    table = _table(f"voxdepth, {default.size}, one core", "p50", "p95", "p99", "max")
    for step, spread in default.steps.items():
        table.add_row(f"  {step}", *_times(spread))
    table.add_row("[bold]frame[/bold]", *_times(default.frame))
    console.print(table)
    found = default.frame.n - default.lost_frames
    console.print(f"{default.frame.n} frames were measured; in {found} the camera was found", highlight=False)


def _print_parts(console: Console, parts: Parts) -> None:
    table = _table(f"paper, {parts.size}, one core", "p50", "p95", "p99", "max")
    for step, spread in parts.steps.items():
        table.add_row(f"  {REGISTERING.get(step, step)}", *_times(spread))
        if step == "filter":
            table.add_row("[bold]correction state, sum of the above[/bold]", *_times(parts.state))
    table.add_row("frame without fusion", *_times(parts.frame), end_section=True)
    for step, spread in parts.fusion_steps.items():
        table.add_row(f"  fusion, {step}", *_times(spread))
    table.add_row("[bold]fusion of 10 frames[/bold]", *_times(parts.fusion))
    console.print(table)
    console.print(f"{parts.state.n} frames and {parts.fusion.n} fusions were measured", highlight=False)


def _print_libraries(console: Console, libraries: Mapping[str, Mapping[str, Spread]], size: str) -> None:
    table = _table(f"paper, {size}, median of a step by library", *libraries, "fastest")
    for step in STEPS:
        medians = [f"{measured[step].p50_ms:.2f} ms" for measured in libraries.values()]
        table.add_row(step, *medians, fastest(libraries, step))
    console.print(table)


def _print_sizes(console: Console, sizes: Sequence[Parts]) -> None:
    pixels, times_ms = [parts.pixels for parts in sizes], [parts.state.p50_ms for parts in sizes]
    start_ms, pixel_ns = line_through(pixels, times_ms)
    table = _table("paper, medians by image size", "state", "per pixel", "line", "fusion")
    for parts in sizes:
        table.add_row(
            parts.size,
            f"{parts.state.p50_ms:.2f} ms",
            f"{1e6 * parts.state.p50_ms / parts.pixels:.1f} ns",
            f"{start_ms + 1e-6 * pixel_ns * parts.pixels:.2f} ms",
            f"{parts.fusion.p50_ms:.1f} ms",
        )
    console.print(table)
    console.print(f"line: {start_ms:.2f} ms a frame and {pixel_ns:.1f} ns a pixel", highlight=False)


def _print_throughput(console: Console, runs: Sequence[Throughput], size: str) -> None:
    title = f"paper, {runs[0].frames} frames of {size} from files"
    table = _table(title, "lag", "frames/s", "ratio", "p50", "p99", "max", "fused")
    for run in runs:
        table.add_row(
            run.way,
            str(run.lag),
            f"{run.frames_per_s:.1f}",
            f"{run.frames_per_s / runs[0].frames_per_s:.2f}",
            *(f"{time_ms:.1f} ms" for time_ms in (run.latency.p50_ms, run.latency.p99_ms, run.latency.max_ms)),
            str(run.windows),
        )
    console.print(table)
    console.print("times: from the end of reading to delivery; fused: windows that became templates", soft_wrap=True)


def _print_memory(console: Console, memory: Sequence[Memory]) -> None:
    table = _table("resident memory", "libraries", "frames kept", "correcting, at the peak")
    for found in memory:
        figures_mb = (found.libraries_mb, found.frames_mb, found.correcting_mb)
        table.add_row(f"{found.corrector}, {found.size}", *(f"{figure_mb:.0f} MB" for figure_mb in figures_mb))
    console.print(table)


def _table(title: str, *headings: str) -> Table:
    table = Table(title=title, title_justify="left")
    table.add_column("")
    for heading in headings:
        table.add_column(heading, justify="right")
    return table


def _times(spread: Spread) -> list[str]:
    return [f"{time_ms:.2f} ms" for time_ms in (spread.p50_ms, spread.p95_ms, spread.p99_ms, spread.max_ms)]
