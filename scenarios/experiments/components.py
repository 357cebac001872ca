"""Table componentlatency: the time of each component of the paper's method."""

from functools import partial

import pandas as pd
from matplotlib.axes import Axes

from voxdepth import PaperVoxDepth
from voxdepth.paper.config import PaperConfig
from voxdepth.paper.epochs import Phase
from voxdepth.tools.benchmark.frames import FrameLoop
from voxdepth.tools.benchmark.timings import Latency
from voxdepth.tools.table import Column, Table

from ..errors import ScenarioError
from ..results.figure import grouped_bars, label_axes, panels
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .paper_results import COMPONENTS_MS, percentages_table

STEPS = {
    "fusion": ("motion", "voxelise", "project"),
    "inpainting": ("inpaint",),
    "transform": ("describe", "register"),
    "combine": ("warp", "merge", "filter"),
}
"""Steps of the corrector that make up each of the paper's components."""
PER_EPOCH = ("fusion", "inpainting")
"""Components that run once in an epoch."""
CONFIG = PaperConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs in parallel to what is measured; epochs are short, so that a window is fused every 29 frames."""
IMAGES = 16
"""Distinct frames in memory, which are played forwards and backwards."""
COLUMNS = (
    "images", "component", Column("p50", "ms"), Column("p95", "ms"), "n", Column("paper, Jetson Nano", "ms"),
    Column("paper, workstation", "ms"),
)  # fmt: skip


def time_components(context: ExperimentContext) -> Findings:
    """Time the steps of the corrector over many frames and fusions."""
    rows = []
    for name in context.sequences:
        loop = context.frame_loop(name, IMAGES)
        context.report(f"correcting {context.frames} frames of {name}, {loop.size}")
        rows += [
            (f"{name} {loop.size}", component, latency.p50_ms, latency.p95_ms, latency.n, *COMPONENTS_MS[component])
            for component, latency in component_latencies(loop, context.frames).items()
        ]
    table = Table.of("Time of each component, OpenCV on one thread", COLUMNS, rows)
    medians_ms = table.pivot("component", "images", "p50")
    return Findings(
        tables=(table, percentages_table("components")),
        claims=tuple(_claim(str(images), medians_ms[images]) for images in medians_ms),
        notes=(
            "Fusion and inpainting run once in an epoch, the others on every frame. Reading is not timed.",
            "Frames before the second template are warm-up. Nothing runs in parallel.",
            f"Combine is warp, merge and median filter. {IMAGES} images are played forwards and backwards.",
        ),
        figure=panels("Time of each component", [partial(_draw, table)]),
    )


def component_latencies(loop: FrameLoop, frames: int) -> dict[str, Latency]:
    """Times of each component over the frames in the correction state, and over all fusions but the first.

    Nothing is timed before the second template, which ends the warm-up.

    Raises:
        ScenarioError: No frame was corrected, or no second window was fused.
    """
    corrector, template = PaperVoxDepth(loop.intrinsics, CONFIG), None
    frames_s, fusions_s = [], []
    for frame in loop.play(frames):
        aligned = corrector.align(frame)
        corrected = corrector.combine(aligned)
        if aligned.template is not None and aligned.template is not template:
            template = aligned.template
            fusions_s.append(template.timings_s)
        if len(fusions_s) > 1 and aligned.diagnostics.phase is Phase.CORRECTING:
            frames_s.append(corrected.timings_s)
    corrector.close()
    if not frames_s:
        raise ScenarioError(f"at {loop.size} pixels no second template came in {frames} frames: ask for more frames")
    return {
        component: Latency.of(
            [sum(times_s[step] for step in steps)
             for times_s in (fusions_s[1:] if component in PER_EPOCH else frames_s)]
        )
        for component, steps in STEPS.items()
    }  # fmt: skip


def _claim(images: str, medians_ms: pd.Series) -> Claim:
    others_ms = medians_ms.drop("fusion")
    second = others_ms.idxmax()
    times = medians_ms["fusion"] / others_ms[second]
    return Claim(
        paper="fusion takes longest, 2.9 times as long as the next, which is inpainting (280 and 94 ms: 2.98 times)",
        found=f"{images}: fusion takes {times:.1f} times as long as the next, {second}",
        holds=bool(times > 1) and second == "inpainting",
    )


def _draw(table: Table, axes: Axes) -> None:
    medians_ms, counts = (table.pivot("component", "images", name) for name in ("p50", "n"))
    for k, machine in enumerate(("Jetson Nano", "workstation")):
        medians_ms[f"paper, {machine}"] = [COMPONENTS_MS[component][k] for component in medians_ms.index]
    axes.set_yscale("log")
    label_axes(axes, "median, ours with OpenCV on one thread", "component", "time [ms]")
    names = [f"{component}\nn = {n:.0f}" for component, n in counts.iloc[:, -1].items()]
    grouped_bars(axes, names, medians_ms.to_dict("list"))


COMPONENTS = Experiment(
    "components", "How long does each component of the corrector take (Table componentlatency)?",
    time_components, ("sim-LN",), frames=300, width_px=640, min_frames=80,
)  # fmt: skip
