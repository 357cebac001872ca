"""Table componentlatency: the time of each component of the paper's method."""

import pandas as pd

from .experiment import Claim, Experiment, ExperimentResult, pivot
from .measures.component_times import MEDIAN, component_times
from .paper import COMPONENTS_MS
from .plots import picture, plotted

PAPER = ["paper, Jetson Nano [ms]", "paper, workstation [ms]"]


def answer(experiment: Experiment) -> ExperimentResult:
    """Time the steps of the corrector over many frames and fusions."""
    times = experiment.of_each(
        lambda name: component_times(experiment.recording(name).intrinsics, list(experiment.frames_of(name)))
    )
    printed = pd.DataFrame(COMPONENTS_MS, PAPER).T
    shown = pivot(times, "component", "sequence", MEDIAN).join(printed)
    panel = plotted(shown, "", "", "time [ms]", kind="bar", logy=True)
    figure = picture("Median time of each component, OpenCV on one thread", [panel])
    return ExperimentResult(table=times.join(printed, on="component"), figure=figure)


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
