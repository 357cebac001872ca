"""The paper's central figures: the steps of one epoch, and the frame that it corrects beside every rival."""

import pandas as pd

from voxdepth.colors import colored, far_end_m

from ..figure import Draw, image_shown
from .experiment import Claim, Experiment, ExperimentResult, all_hold, pivot
from .measures.epoch_images import CONFIG, FILLED, PROJECTION, TEMPLATE, Step, epoch_steps
from .plots import picture

DENSE = 95.0
"""From which share of the pixels on we call a template dense [%]."""


def answer(experiment: Experiment) -> ExperimentResult:
    """Follow the last frame of each sequence that a template corrects back to the window of the template."""
    found = [(name, step) for name in experiment.sequences for step in epoch_steps(experiment, name)]
    table = pd.DataFrame([{"sequence": name, **step.errors} for name, step in found if not step.is_gray])
    title = "The steps of one epoch, and the frame that it corrects as every method gives it; in brackets its number"
    figure = picture(title, [drawn(step) for _, step in found], columns=5, panel_in=(2.4, 1.7))
    return ExperimentResult(table=table, figure=figure)


def drawn(step: Step) -> Draw:
    """Return the panel of a step."""
    image = step.image if step.is_gray else colored(step.image, far_end_m([step.truth_m]))[..., ::-1]
    return image_shown(f"{step.name} ({step.frame})", image, cmap="gray", interpolation="nearest")


def claims(table: pd.DataFrame) -> tuple[Claim, ...]:
    """Return the claim that inpainting makes a dense template of a sparse projection."""
    filled = pivot(table, "sequence", "step", FILLED)
    return (
        Claim(
            "the projection of the fused voxels is sparse, and inpainting makes a dense template of it",
            "; ".join(f"{name} {of[PROJECTION]:.0f} % and {of[TEMPLATE]:.0f} %" for name, of in filled.iterrows()),
            all_hold((filled[PROJECTION] < filled[TEMPLATE]) & (filled[TEMPLATE] > DENSE)),
            f"the template has depth in more than {DENSE:g} % of the pixels, and the projection in fewer",
        ),
    )


EXPERIMENT = Experiment(
    question="What does each step of the method do with a scene, and how do the methods differ?",
    answer=answer,
    claims=claims,
    notes=(
        "Depth is red where near, blue where far and black where missing. The numbers are of surfaces within 20 m, and "
        "MAE is of those that have a depth. VD-code is the method as its authors' code has it.",
    ),
    sequences=("sim-LN",),
    frames=24,
    least_frames=CONFIG.window_frames + 1,
    width_px=640,
)
