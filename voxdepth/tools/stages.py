"""The stages of the paper's method in a recording: fused voxels, template and warped template."""

import numpy as np
import rerun as rr

from ..colors import FAR_M
from ..geometry import transform
from ..paper.epochs import Template, VoxDepthDiagnostics
from ..types import CorrectedDepth, FloatArray
from .stream import Log, depth_colors

MOST_POINTS = 20_000
"""Voxels of a cloud that are recorded; of more, every n-th."""
VOXEL_COLOR, VOXEL_RADIUS_M = (180, 60, 210), 0.05


def new_template(corrected: CorrectedDepth) -> Template | None:
    """Return the template of the paper's method if an epoch begins with this frame."""
    stages = corrected.diagnostics
    return stages.template if isinstance(stages, VoxDepthDiagnostics) and stages.new_epoch else None


def log_warped(log: Log, corrected: CorrectedDepth, far_m: float = FAR_M) -> None:
    """Record the template as the paper's method warped it for a frame, black if it did not; others record nothing."""
    stages = corrected.diagnostics
    if isinstance(stages, VoxDepthDiagnostics):
        warped_m = stages.warped_template_m
        shown_m = np.zeros_like(corrected.depth_m) if warped_m is None else warped_m
        log("colors/warped", depth_colors(shown_m, far_m))


def voxel_cloud(template: Template, T_world_cam: FloatArray) -> rr.Points3D:
    """Return voxels of a template as points in the world, given the pose of its camera, shape (4, 4)."""
    points_m = transform(T_world_cam, template.voxels.centres_m)
    return rr.Points3D(points_m[:: -(-len(points_m) // MOST_POINTS) or 1], colors=[VOXEL_COLOR], radii=[VOXEL_RADIUS_M])
