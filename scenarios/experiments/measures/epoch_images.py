"""The images of one epoch: from the window that is fused to the frame that its template corrects, beside all rivals."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from swarm.perception import frame_of
from voxdepth import VoxDepth
from voxdepth.metrics import Sums
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.registry import DEFAULT, create_bare
from voxdepth.tools.evaluation.frames import NEAR_M
from voxdepth.types import FloatImage

from ...errors import ScenarioError
from ..experiment import Experiment
from ..paper import OURS

CONFIG = VoxDepthConfig(fusion_lag_frames=0)
"""Fusing waits, so that a template is of the frame in which it appears."""
PROJECTION, TEMPLATE, FILLED = "sparse projection", "template", "with depth [%]"


class Step(NamedTuple):
    """Gray values or a depth [m], shape (H, W), and the true depth of the same frame [m]."""

    name: str
    frame: int
    image: npt.NDArray[Any]
    truth_m: FloatImage

    @property
    def is_gray(self) -> bool:
        """Whether it has gray values, and no depth."""
        return self.image.dtype == np.uint8

    @property
    def errors(self) -> dict[str, Any]:
        """What is known of its depth on the surfaces within 20 m."""
        sums = Sums.of(self.image, self.truth_m, self.truth_m < np.float32(NEAR_M))
        filled = None if sums.coverage is None else 100 * sums.coverage
        return {"step": self.name, "frame": self.frame, FILLED: filled, "MAE [m]": sums.mae_m, "n pixels": sums.filled}


def epoch_steps(experiment: Experiment, name: str) -> Iterator[Step]:
    """Yield the steps of a sequence in the order of the paper's figures; a `ScenarioError` if no frame is corrected.

    They are those of the last frame that a template corrects, and of the window of this template.
    """
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
