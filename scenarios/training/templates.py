"""Sparse projections of fused clouds with the truth, of which `convex` learns to make templates."""

from typing import NamedTuple

import numpy as np

from voxdepth.paper.config import VoxDepthConfig
from voxdepth.paper.method import MOTION_MODELS
from voxdepth.paper.odometry import PhotometricOdometry
from voxdepth.paper.steps import create_steps
from voxdepth.types import FloatImage, Frame

from .clips import Clip
from .samples import RATE_HZ

CONFIG = VoxDepthConfig()


class SparseTemplate(NamedTuple):
    """What is fused of a clip, in the pixels of its last frame, shape (H, W)."""

    sparse_m: FloatImage
    """Projected depth [m]; 0 = empty."""
    true_m: FloatImage
    """True depth [m]; 0 in the sky."""


def template_of(clip: Clip) -> SparseTemplate:
    """Fuse a clip as VoxDepth fuses a window."""
    camera = clip.intrinsics
    frames = [
        Frame(stamp_s=index / RATE_HZ, gray=gray, depth_m=raw_m)
        for index, (gray, raw_m) in enumerate(zip(clip.gray, clip.raw_m, strict=True))
    ]
    steps = create_steps("cpu", camera, CONFIG)
    steps.clear()
    poses = MOTION_MODELS[CONFIG.motion](frames, PhotometricOdometry(camera, CONFIG.odometry))
    for frame, T_last_frame in zip(frames, poses, strict=True):
        if T_last_frame is not None:
            steps.integrate(frame.depth_m, T_last_frame)
    true_m = clip.true_m[-1]
    return SparseTemplate(np.asarray(steps.project()), np.where(np.isfinite(true_m), true_m, np.float32(0)))


def cropped(template: SparseTemplate, rng: np.random.Generator, side_px: int) -> SparseTemplate:
    """A random square part of a template, padded with empty pixels where it is smaller."""
    height, width = template.sparse_m.shape
    top, left = rng.integers(max(1, height - side_px + 1)), rng.integers(max(1, width - side_px + 1))
    pad = ((0, max(0, side_px - height)), (0, max(0, side_px - width)))
    parts = (np.pad(image[top : top + side_px, left : left + side_px], pad) for image in template)
    return SparseTemplate(*parts)
