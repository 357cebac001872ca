"""The paper's pictures: the stages of one epoch, and the frame that it corrects beside the other methods."""

from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from swarm.perception import frame_of
from voxdepth import VoxDepth
from voxdepth.colors import colored, far_end_m
from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.inpainting import Inpainting
from voxdepth.paper.steps import HostSteps
from voxdepth.registry import create_corrector
from voxdepth.tools.table import Column, Table
from voxdepth.types import FloatImage

from ..errors import ScenarioError
from ..results.figure import panels
from .experiment import Claim, Experiment, ExperimentContext, Findings, all_hold
from .quality import METHODS

CONFIG = VoxDepthConfig(fusion_lag_frames=0)
"""Fusing waits, so that a template is of the frame in which it appears."""
SPARSE = CONFIG.model_copy(update={"inpainting": Inpainting(size_px=1)})
"""Without inpainting: the template is the projection of the voxels."""
PROJECTION, TEMPLATE, RAW, TRUTH = "voxel projection", "template", "frame as measured", "truth"
NEAR_M, DENSE = 20.0, 0.95
COLUMNS = ("sequence", "stage", "frame", Column("with depth", "%", ".1f"), Column("MAE", "m"), "n pixels")
PANEL_COLUMNS, PANEL_IN = 5, (2.4, 1.7)


class Stage(NamedTuple):
    """An image of the figure: gray values or a depth [m], shape (H, W), and the true depth of the same frame [m]."""

    name: str
    frame: int
    image: npt.NDArray[Any]
    truth_m: FloatImage


def draw_steps(context: ExperimentContext) -> Findings:
    """Follow the last frame of each sequence that a template corrects back to the window of the template."""
    found = {name: list(stages(context, name)) for name in context.sequences}
    rows = [(name, *_row(stage)) for name, all_of in found.items() for stage in all_of if stage.image.dtype != np.uint8]
    table = Table.of("The stages of one epoch, surfaces within 20 m", COLUMNS, rows)
    filled = table.pivot("stage", "sequence", "with depth")
    sparse, dense = filled.loc[PROJECTION], filled.loc[TEMPLATE]
    return Findings(
        tables=(table,),
        claims=(
            Claim(
                paper="the projection of the fused voxels is sparse, and inpainting makes a dense template of it",
                found="; ".join(f"{name} {sparse[name]:.0f} % and {dense[name]:.0f} %" for name in found),
                holds=all_hold((sparse < dense) & (dense > 100 * DENSE)),
            ),
        ),
        notes=(
            "Depth is red where near, blue where far and black where missing. The numbers are of surfaces within "
            "20 m, and MAE is of those that have a depth. VD-code is the method as its authors' code has it.",
        ),
        figure=panels(
            "The stages of one epoch, the frame that it corrects, and the same frame by every method",
            [partial(_draw, stage) for all_of in found.values() for stage in all_of],
            columns=PANEL_COLUMNS,
            panel_in=PANEL_IN,
        ),
    )


def stages(context: ExperimentContext, name: str) -> Iterator[Stage]:
    """The images of a sequence in the order of the paper's figure; a `ScenarioError` if no frame is corrected."""
    camera, captures = context.recording(name).intrinsics, list(context.captures(name))
    frames, truths_m = [frame_of(capture) for capture in captures], [capture.depth_true_m for capture in captures]
    dense, sparse = VoxDepth(camera, CONFIG), VoxDepth(camera, SPARSE)
    aligned = [(dense.align(frame), sparse.align(frame)) for frame in frames]
    corrected = [k for k, (own, _) in enumerate(aligned) if own.diagnostics.registration.ok]
    if not corrected:
        raise ScenarioError(f"no template fits a frame of {name}: ask for more --frames, or another sequence")
    at = corrected[-1]
    own, projected = aligned[at]
    last = next(k for k, (before, _) in enumerate(aligned) if before.template is own.template)
    warp, M = HostSteps(camera, CONFIG).warp, own.diagnostics.registration.M_frame_template
    first = last - CONFIG.window_frames + 1
    yield Stage("first gray image of the window", first, frames[first].gray, truths_m[first])
    yield Stage("first frame of the window", first, frames[first].depth_m, truths_m[first])
    yield Stage("last frame of the window", last, frames[last].depth_m, truths_m[last])
    yield Stage(PROJECTION, last, projected.template.depth, truths_m[last])
    yield Stage(TEMPLATE, last, own.template.depth, truths_m[last])
    yield Stage("gray image", at, frames[at].gray, truths_m[at])
    yield Stage(RAW, at, frames[at].depth_m, truths_m[at])
    yield Stage("aligned template", at, warp(own.template.depth, M).copy(), truths_m[at])
    yield Stage("result", at, dense.combine(own).depth_m, truths_m[at])
    yield Stage(TRUTH, at, truths_m[at], truths_m[at])
    for label, method in list(METHODS.items())[:-1]:  # without raw, which is there already
        corrector = create_corrector(method, camera)
        *_, result = map(corrector.process, frames[: at + 1])
        yield Stage(f"{label}: {method}", at, result.depth_m, truths_m[at])


def _row(stage: Stage) -> tuple[str, int, float, float | None, int]:
    near = stage.truth_m < NEAR_M
    judged = (stage.image > 0) & near
    errors_m = np.abs(stage.image[judged] - stage.truth_m[judged])
    mae_m = float(errors_m.mean()) if errors_m.size else None
    return stage.name, stage.frame, 100 * errors_m.size / int(near.sum()), mae_m, errors_m.size


def _draw(stage: Stage, axes: Axes) -> None:
    is_gray = stage.image.dtype == np.uint8
    image = stage.image if is_gray else colored(stage.image, far_end_m([stage.truth_m]))[..., ::-1]
    axes.imshow(image, cmap="gray")
    axes.set_title(f"{stage.name} ({stage.frame})", fontsize=8)
    axes.set_axis_off()


STEPS = Experiment(
    "steps", "What does each stage of the method do with a scene (Fig. flowwithimage)?",
    draw_steps, ("sim-LN",), frames=24, width_px=640, min_frames=CONFIG.window_frames + 1,
)  # fmt: skip
