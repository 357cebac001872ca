"""Table componentlatency: the time of each part of the corrector."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING

from ..benchmark.frames import FrameLoop
from ..benchmark.timings import Latency, time_paper
from .drawing import labelled, panels
from .paper import COMPONENTS_MS
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEPS = {
    "fusion": ("place", "voxelise", "project"),
    "inpainting": ("inpaint",),
    "transform": ("describe", "register"),
    "combine": ("warp", "merge", "filter"),
}
"""What the corrector calls the steps of each of the paper's components."""
PER_EPOCH = ("fusion", "inpainting")
"""Components that work once in an epoch."""
IMAGES = 16
"""Distinct frames in memory, which are played forwards and backwards."""


class Components:
    """The corrector's own clocks over many frames and fusions."""

    name = "components"
    question = "How long does each component of the corrector take (Table componentlatency)?"
    scope = Scope(sequences=("sim-LN",), frames=300, width_px=640, least_frames=80)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        measured = {}
        for name in stage.sequences:
            clip = stage.clip(name, IMAGES)
            stage.tell(f"correcting {stage.frames} frames of {name}, {clip.size}")
            measured[f"{name} {clip.size}"] = component_times(clip, stage.frames)
        columns = (
            Column(name="images"),
            Column(name="component"),
            Column(name="p50", unit="ms"),
            Column(name="p95", unit="ms"),
            Column(name="n", places=0),
            Column(name="paper, Jetson Nano", unit="ms", places=0),
            Column(name="paper, workstation", unit="ms", places=0),
        )
        rows = [
            (where, part, spread.p50_ms, spread.p95_ms, spread.n, *COMPONENTS_MS[part])
            for where, spreads in measured.items()
            for part, spread in spreads.items()
        ]
        return Result(
            tables=(Table.of("Time of each component, OpenCV on one thread", columns, rows),),
            claims=tuple(_claim(where, spreads) for where, spreads in measured.items()),
            notes=(
                "Fusion and inpainting work once in an epoch, the others on every frame. Reading is not timed.",
                "Frames before the second template are warm-up. Nothing is fused beside what is measured.",
                f"Combine is warp, merge and median filter. {IMAGES} images are played forwards and backwards.",
            ),
            figure=panels("Time of each component", partial(_draw, measured)),
        )


def component_times(clip: FrameLoop, frames: int) -> dict[str, Latency]:
    """Times of each component over the frames in the correction state, and over all fusions but the first.

    Raises:
        ScenarioError: No frame was corrected, or no second window was fused.
    """
    times = time_paper(clip, frames)
    return {
        part: _spread(times.fusions_s if part in PER_EPOCH else times.steps_s, steps) for part, steps in STEPS.items()
    }


def _spread(times_s: Sequence[Mapping[str, float]], steps: Sequence[str]) -> Latency:
    return Latency.of([sum(of_one[step] for step in steps) for of_one in times_s])


def _claim(where: str, spreads: Mapping[str, Latency]) -> Claim:
    medians_ms = {part: spread.p50_ms for part, spread in spreads.items()}
    fusion_ms = medians_ms.pop("fusion")
    second = max(medians_ms, key=lambda part: medians_ms[part])
    return Claim(
        paper="fusion takes longest, 2.9 times as long as the next, which is inpainting (280 and 94 ms: 2.98 times)",
        found=f"{where}: fusion takes {fusion_ms / medians_ms[second]:.1f} times as long as the next, {second}",
        holds=fusion_ms > medians_ms[second] and second == "inpainting",
    )


def _draw(measured: Mapping[str, Mapping[str, Latency]], axes: "Axes") -> None:
    series: dict[str, list[float]] = {where: [s.p50_ms for s in found.values()] for where, found in measured.items()}
    series |= {
        f"paper, {name}": [COMPONENTS_MS[part][k] for part in STEPS]
        for k, name in enumerate(("Jetson Nano", "workstation"))
    }
    width = 0.8 / len(series)
    for k, (name, times_ms) in enumerate(series.items()):
        axes.bar(
            [place + (k - (len(series) - 1) / 2) * width for place in range(len(STEPS))], times_ms, width, label=name
        )
    counts = {part: spread.n for found in measured.values() for part, spread in found.items()}
    axes.set_xticks(range(len(STEPS)), [f"{part}\nn = {counts[part]}" for part in STEPS], fontsize=8)
    axes.set_yscale("log")
    labelled(axes, "median, ours with OpenCV on one thread", "component", "time [ms]")
    axes.legend(fontsize=7)
