"""The paper's central figures: the steps of one epoch, and the frame that it corrects beside every rival."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd

from swarm.perception import frame_of
from voxdepth import VoxDepth
from voxdepth.colors import colored, far_end_m
from voxdepth.metrics import Sums
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import DEFAULT, create_bare
from voxdepth.tools.evaluation.frames import NEAR_M
from voxdepth.types import FloatImage

from ..errors import ScenarioError
from ..figure import Draw, image_shown
from .experiment import Claim, Experiment, ExperimentResult, all_hold, pivot
from .paper import OURS
from .plots import picture

CONFIG = VoxDepthConfig(fusion_lag_frames=0)
"""Fusing waits, so that a template is of the frame in which it appears."""
PROJECTION, TEMPLATE, FILLED, DENSE = "sparse projection", "template", "with depth [%]", 95.0


class Step(NamedTuple):
    """Gray values or a depth [m], shape (H, W), and the true depth of the same frame [m]."""

    name: str
    frame: int
    image: npt.NDArray[Any]
    truth_m: FloatImage

    @property
    def row(self) -> dict[str, Any]:
        """What is known of the surfaces within 20 m."""
        sums = Sums.of(self.image, self.truth_m, self.truth_m < np.float32(NEAR_M))
        filled = None if sums.coverage is None else 100 * sums.coverage
        return {"step": self.name, "frame": self.frame, FILLED: filled, "MAE [m]": sums.mae_m, "n pixels": sums.filled}

    @property
    def drawn(self) -> Draw:
        """Its panel."""
        is_gray = self.image.dtype == np.uint8
        image = self.image if is_gray else colored(self.image, far_end_m([self.truth_m]))[..., ::-1]
        return image_shown(f"{self.name} ({self.frame})", image, cmap="gray", interpolation="nearest")


def answer(experiment: Experiment) -> ExperimentResult:
    """Follow the last frame of each sequence that a template corrects back to the window of the template."""
    found = [(name, step) for name in experiment.sequences for step in steps(experiment, name)]
    table = pd.DataFrame([{"sequence": name, **step.row} for name, step in found if step.image.dtype != np.uint8])
    title = "The steps of one epoch, and the frame that it corrects as every method gives it; in brackets its number"
    return ExperimentResult(
        table=table, figure=picture(title, [step.drawn for _, step in found], columns=5, panel_in=(2.4, 1.7))
    )


def steps(experiment: Experiment, name: str) -> Iterator[Step]:
    """Yield the images of a sequence in the order of the paper's figures; a `ScenarioError` if none is corrected."""
    camera, captures = experiment.recording(name).intrinsics, list(experiment.captures(name))
    frames = list(map(frame_of, captures))
    results = list(map(VoxDepth(camera, CONFIG).process, frames))
    states: list[Any] = [result.diagnostics for result in results]
    at = max((k for k, state in enumerate(states) if state.warped_template_m is not None), default=None)
    if at is None:
        raise ScenarioError(f"no template fits a frame of {name}: ask for more --frames, or another sequence")
    template = states[at].template
    last = next(k for k, state in enumerate(states) if state.template is template)
    first = last - CONFIG.window_frames + 1
    images = [
        ("first of the window", first, frames[first].gray),
        ("its depth", first, frames[first].depth_m),
        (PROJECTION, last, template.projection_m),
        (TEMPLATE, last, template.depth_m),
        ("frame", at, frames[at].gray),
        ("aligned template", at, states[at].warped_template_m),
        ("result", at, results[at].depth_m),
        ("truth", at, captures[at].depth_true_m),
    ]
    yield from (Step(*image, captures[image[1]].depth_true_m) for image in images)
    for label, method in {**dict(reversed(OURS.items())), DEFAULT: DEFAULT}.items():
        *_, rival = map(create_bare(method, camera).process, frames[: at + 1])
        shown = label if label == method else f"{label}: {method}"
        yield Step(shown, at, rival.depth_m, captures[at].depth_true_m)


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
