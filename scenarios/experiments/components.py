"""Table componentlatency: the time of each component of the paper's method."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import pandas as pd

from voxdepth import VoxDepth
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.epochs import Phase
from voxdepth.types import Frame

from ..errors import ScenarioError
from .experiment import Claim, Experiment, ExperimentResult, pivot
from .paper import COMPONENTS_MS
from .plots import picture, plotted

PER_EPOCH = {"fusion": ["motion", "voxelise", "project"], "inpainting": ["inpaint"]}
PER_FRAME = {"transform": ["describe", "register"], "combine": ["warp", "merge", "filter"]}
"""Steps of the corrector that make up each of the paper's components."""
CONFIG = VoxDepthConfig(max_epoch_frames=20, fusion_lag_frames=0)
"""Nothing runs in parallel to what is measured; epochs are short, so that a window is fused every 29 frames."""
ROUNDS, RATE_HZ = 5, 30.0
"""How often the frames are played forwards and backwards, and how fast by their times."""
MEDIAN, PAPER = "median [ms]", ("paper, Jetson Nano [ms]", "paper, workstation [ms]")


def answer(experiment: Experiment) -> ExperimentResult:
    """Time the steps of the corrector over many frames and fusions."""
    found = {}
    for name in experiment.sequences:
        frames = list(experiment.frames_of(name))
        played = (replace(frame, stamp_s=k / RATE_HZ) for k, frame in enumerate((frames + frames[::-1]) * ROUNDS))
        times = component_times_ms(VoxDepth(experiment.recording(name).intrinsics, CONFIG), played)
        found[name] = pd.DataFrame({
            component: {MEDIAN: of_ms.median(), "95th percentile [ms]": of_ms.quantile(0.95), "n": len(of_ms)}
            for component, of_ms in times.items()
        }).T  # fmt: skip
    printed = pd.DataFrame(COMPONENTS_MS, PAPER).T
    table = (
        pd.concat(found, names=["sequence", "component"]).astype({"n": int}).join(printed, on="component").reset_index()
    )
    shown = pivot(table, "component", "sequence", MEDIAN).join(printed)
    panel = plotted(shown, "", "", "time [ms]", kind="bar", logy=True)
    return ExperimentResult(table=table, figure=picture("Median time of each component, OpenCV on one thread", [panel]))


def component_times_ms(corrector: VoxDepth, frames: Iterable[Frame]) -> dict[str, pd.Series]:
    """Return times by component [ms]: of all fusions but the first, and of each frame corrected after the second.

    A `ScenarioError` if no frame was corrected by a second template.
    """
    template, fusions_s, steps_s = None, [], []
    for corrected in map(corrector.process, frames):
        state: Any = corrected.diagnostics
        if state.template is not None and state.template is not template:
            template = state.template
            fusions_s.append(template.timings_s)
        if len(fusions_s) > 1 and state.phase is Phase.CORRECTING:
            steps_s.append(corrected.timings_s)
    if not steps_s:
        raise ScenarioError("no frame was corrected by a second template: ask for more --frames or a larger --width")
    parts = (1000 * pd.DataFrame(fusions_s[1:]), PER_EPOCH), (1000 * pd.DataFrame(steps_s), PER_FRAME)
    return {name: times_ms[steps].sum(axis=1) for times_ms, components in parts for name, steps in components.items()}


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claim that fusion takes longest and inpainting is next, in each sequence."""
    medians_ms = pivot(table, "component", "sequence", MEDIAN)
    others_ms = medians_ms.drop("fusion")
    times, seconds = medians_ms.loc["fusion"] / others_ms.max(), others_ms.idxmax()
    return (
        Claim(
            "fusion takes longest, 2.9 times as long as the next, which is inpainting (280 and 94 ms: 2.98 times)",
            "; ".join(
                f"{name}: fusion {times[name]:.1f} times as long as the next, {seconds[name]}" for name in times.index
            ),
            bool((times > 1).all() and (seconds == "inpainting").all()),
            "fusion takes longest, and inpainting is next",
        ),
    )


EXPERIMENT = Experiment(
    question="How long does each component of the corrector take?",
    answer=answer,
    claims=claims,
    notes=(
        "Fusion and inpainting run once in an epoch, the others on every frame; combine is warp, merge and median "
        "filter. Reading is not timed, nothing runs in parallel, and the first template is warm-up.",
    ),
    sequences=("sim-LN",),
    frames=30,
    least_frames=16,
    width_px=640,
)
