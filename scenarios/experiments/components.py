"""Table componentlatency: the time of each component of the paper's method."""

from collections.abc import Iterable
from dataclasses import replace

import pandas as pd

from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import Phase
from voxdepth.tools.figure import panels, plotted
from voxdepth.types import Frame

from ..errors import ScenarioError
from .experiment import Claim, ExperimentContext, Findings, asks, pivot
from .paper_results import COMPONENTS_MS

PER_EPOCH = {"fusion": ["motion", "voxelise", "project"], "inpainting": ["inpaint"]}
PER_FRAME = {"transform": ["describe", "register"], "combine": ["warp", "merge", "filter"]}
"""Steps of the corrector that make up each of the paper's components."""
CONFIG = VoxDepthConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs in parallel to what is measured; epochs are short, so that a window is fused every 29 frames."""
ROUNDS, RATE_HZ = 5, 30.0
"""How often the frames are played forwards and backwards, and how fast by their times."""


@asks(
    "How long does each component of the corrector take (Table componentlatency)?",
    sequences=("sim-LN",), frames=30, width_px=640, min_frames=16,
)  # fmt: skip
def components(context: ExperimentContext) -> Findings:
    """Time the steps of the corrector over many frames and fusions."""
    rows = []
    for name in context.sequences:
        camera = context.recording(name).intrinsics
        frames = list(context.frames_of(name))
        played = (frames + frames[::-1]) * ROUNDS
        stamped = (replace(frame, stamp_s=k / RATE_HZ) for k, frame in enumerate(played))
        rows += [
            {
                "images": f"{name} {camera.width_px}x{camera.height_px}",
                "component": component,
                "p50 [ms]": times_ms.median(),
                "p95 [ms]": times_ms.quantile(0.95),
                "n": len(times_ms),
                "paper, Jetson Nano [ms]": COMPONENTS_MS[component][0],
                "paper, workstation [ms]": COMPONENTS_MS[component][1],
            }
            for component, times_ms in component_times_ms(VoxDepth(camera, CONFIG), stamped).items()
        ]
    table = pd.DataFrame(rows)
    medians_ms = pivot(table, "component", "images", "p50 [ms]")
    paper = pd.DataFrame(COMPONENTS_MS, ["paper, Jetson Nano", "paper, workstation"]).T
    return Findings(
        tables={"table": table},
        claims=tuple(_claim(str(images), of_ms) for images, of_ms in medians_ms.items()),
        notes=(
            "Fusion and inpainting run once in an epoch, the others on every frame; combine is warp, merge and median "
            "filter. Reading is not timed, nothing runs in parallel, and the first template is warm-up.",
        ),
        figure=panels(
            "Time of each component: median, ours with OpenCV on one thread",
            [plotted(medians_ms.join(paper), "", "", "time [ms]", kind="bar", rot=0, logy=True)],
        ),
    )


def component_times_ms(corrector: VoxDepth, frames: Iterable[Frame]) -> dict[str, pd.Series]:
    """Times [ms] by component: of all fusions but the first, and of each frame that is corrected after the second.

    A `ScenarioError` if no frame was corrected by a second template.
    """
    template, fusions_s, steps_s = None, [], []
    for frame in frames:
        aligned = corrector.align(frame)
        corrected = corrector.combine(aligned)
        if aligned.template is not None and aligned.template is not template:
            template = aligned.template
            fusions_s.append(template.timings_s)
        if len(fusions_s) > 1 and aligned.diagnostics.phase is Phase.CORRECTING:
            steps_s.append(corrected.timings_s)
    if not steps_s:
        raise ScenarioError("no frame was corrected by a second template: ask for more --frames or a larger --width")
    parts = (1000 * pd.DataFrame(fusions_s[1:]), PER_EPOCH), (1000 * pd.DataFrame(steps_s), PER_FRAME)
    return {name: times_ms[steps].sum(axis=1) for times_ms, components in parts for name, steps in components.items()}


def _claim(images: str, medians_ms: pd.Series) -> Claim:
    others_ms = medians_ms.drop("fusion")
    times, second = medians_ms["fusion"] / others_ms.max(), others_ms.idxmax()
    return Claim(
        "fusion takes longest, 2.9 times as long as the next, which is inpainting (280 and 94 ms: 2.98 times)",
        f"{images}: fusion takes {times:.1f} times as long as the next, {second}",
        bool(times > 1) and second == "inpainting",
        "fusion takes longest, and inpainting is next",
    )
