"""Merging a frame with the registered template: paper, Eq. depthcor."""

import numpy as np
import warp as wp

from . import kernels
from .types import FloatImage, GrayImage, Source
from .voxels import Backend

NEAR_SHARE = 0.5
"""A pixel nearer than this share of the template is invalid (paper, "less than half")."""


def combine(raw_m: FloatImage, template_m: FloatImage, *, backend: Backend = "numpy") -> tuple[FloatImage, GrayImage]:
    """Replace the invalid pixels of a frame by those of the template.

    A pixel is invalid if it is empty, nearer than half of the template, or farther than the template. Where the
    template is empty the raw pixel stands.

    Args:
        raw_m: Measured depth [m], shape (H, W); 0 = invalid.
        template_m: Template in the frame's pixels [m], shape (H, W); 0 = unknown.
        backend: NumPy is the faster one on a CPU.

    Returns:
        Depth [m] and one `Source` per pixel, both of shape (H, W).
    """
    return (combine_warp if backend == "warp" else combine_numpy)(raw_m, template_m)


def combine_numpy(raw_m: FloatImage, template_m: FloatImage) -> tuple[FloatImage, GrayImage]:
    """The rule in NumPy: the twin of `combine_warp`."""
    plausible = (raw_m >= np.float32(NEAR_SHARE) * template_m) & (raw_m <= template_m) & (raw_m > 0)
    replaced = ~plausible & (template_m > 0)
    depth_m = np.where(replaced, template_m, raw_m)
    source = (raw_m > 0).astype(np.uint8)
    source[replaced] = Source.TEMPLATE
    return depth_m, source


def combine_warp(raw_m: FloatImage, template_m: FloatImage) -> tuple[FloatImage, GrayImage]:
    """The rule as a Warp kernel."""
    depth_m = np.empty_like(raw_m)
    source = np.empty(raw_m.shape, np.uint8)
    inputs = [kernels.view(np.ascontiguousarray(a), wp.float32) for a in (raw_m, template_m)]
    outputs = [
        kernels.view(depth_m, wp.float32),
        kernels.view(source, wp.uint8),
    ]
    wp.launch(kernels.combine, raw_m.shape, inputs=[*inputs, NEAR_SHARE], outputs=outputs, device="cpu")
    return depth_m, source
