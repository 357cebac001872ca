"""The paper's pictures: the stages of one epoch, and the frame that it corrects beside the other methods."""

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
from voxdepth.paper.inpainting import Inpainting
from voxdepth.paper.steps import HostSteps
from voxdepth.registry import create_corrector
from voxdepth.tools.figure import Draw, image_shown, panels
from voxdepth.types import FloatImage

from ..errors import ScenarioError
from .experiment import Claim, ExperimentContext, Findings, all_hold, asks, pivot
from .quality import METHODS

CONFIG = VoxDepthConfig(fusion_lag_frames=0)
"""Fusing waits, so that a template is of the frame in which it appears."""
SPARSE = CONFIG.model_copy(update={"inpainting": Inpainting(size_px=1)})
"""Without inpainting: the template is the projection of the voxels."""
PROJECTION, TEMPLATE = "voxel projection", "template"
NEAR_M, DENSE = 20.0, 95.0


class Stage(NamedTuple):
    """Gray values or a depth [m], shape (H, W), and the true depth of the same frame [m]."""

    name: str
    frame: int
    image: npt.NDArray[Any]
    truth_m: FloatImage

    @property
    def row(self) -> dict[str, Any]:
        """What is known of the surfaces within 20 m."""
        sums = Sums.of(self.image, self.truth_m, self.truth_m < NEAR_M)
        filled = None if sums.coverage is None else 100 * sums.coverage
        row = {"stage": self.name, "frame": self.frame, "with depth [%]": filled}
        return row | {"MAE [m]": sums.mae_m, "n pixels": sums.filled}


@asks(
    "What does each stage of the method do with a scene (Fig. flowwithimage)?",
    sequences=("sim-LN",), frames=24, width_px=640, min_frames=CONFIG.window_frames + 1,
)  # fmt: skip
def steps(context: ExperimentContext) -> Findings:
    """Follow the last frame of each sequence that a template corrects back to the window of the template."""
    found = [(name, stage) for name in context.sequences for stage in stages(context, name)]
    table = pd.DataFrame([{"sequence": name, **of.row} for name, of in found if of.image.dtype != np.uint8])
    filled = pivot(table, "sequence", "stage", "with depth [%]")
    dense = Claim(
        "the projection of the fused voxels is sparse, and inpainting makes a dense template of it",
        "; ".join(f"{name} {of[PROJECTION]:.0f} % and {of[TEMPLATE]:.0f} %" for name, of in filled.iterrows()),
        all_hold((filled[PROJECTION] < filled[TEMPLATE]) & (filled[TEMPLATE] > DENSE)),
        f"the template has depth in more than {DENSE:g} % of the pixels, and the projection in fewer",
    )
    return Findings(
        tables={"table": table},
        claims=(dense,),
        notes=(
            "Depth is red where near, blue where far and black where missing. The numbers are of surfaces within 20 m, "
            "and MAE is of those that have a depth. VD-code is the method as its authors' code has it.",
        ),
        figure=panels(
            "The stages of one epoch, the frame that it corrects, and the same frame by every method",
            [_drawn(stage) for _, stage in found],
            columns=5,
            panel_in=(2.4, 1.7),
        ),
    )


def stages(context: ExperimentContext, name: str) -> Iterator[Stage]:
    """The images of a sequence in the order of the paper's figure; a `ScenarioError` if no frame is corrected."""
    camera, captures = context.recording(name).intrinsics, list(context.captures(name))
    frames, truths_m = [frame_of(capture) for capture in captures], [capture.depth_true_m for capture in captures]
    depths_m = [frame.depth_m for frame in frames]
    dense, sparse = VoxDepth(camera, CONFIG), VoxDepth(camera, SPARSE)
    aligned = [(dense.align(frame), sparse.align(frame)) for frame in frames]
    corrected = [k for k, (own, _) in enumerate(aligned) if own.diagnostics.registration.ok]
    if not corrected:
        raise ScenarioError(f"no template fits a frame of {name}: ask for more --frames, or another sequence")
    at = corrected[-1]
    own, projected = aligned[at]
    last = next(k for k, (before, _) in enumerate(aligned) if before.template is own.template)
    first = last - CONFIG.window_frames + 1
    warped_m = HostSteps(camera, CONFIG).warp(own.template.depth, own.diagnostics.registration.M_frame_template)
    images = [
        ("first gray image of the window", first, frames[first].gray), ("first of the window", first, depths_m[first]),
        ("last of the window", last, depths_m[last]), (PROJECTION, last, projected.template.depth),
        (TEMPLATE, last, own.template.depth), ("gray image", at, frames[at].gray), ("as measured", at, depths_m[at]),
        ("aligned template", at, warped_m), ("result", at, dense.combine(own).depth_m), ("truth", at, truths_m[at]),
    ]  # fmt: skip
    yield from (Stage(*image, truths_m[image[1]]) for image in images)
    for label, method in list(METHODS.items())[:-1]:  # without raw, which is there already
        *_, result = map(create_corrector(method, camera).process, frames[: at + 1])
        yield Stage(f"{label}: {method}", at, result.depth_m, truths_m[at])


def _drawn(stage: Stage) -> Draw:
    is_gray = stage.image.dtype == np.uint8
    image = stage.image if is_gray else colored(stage.image, far_end_m([stage.truth_m]))[..., ::-1]
    return image_shown(f"{stage.name} ({stage.frame})", image, cmap="gray", interpolation="nearest")
