"""How good a trained network is on clips that it has not learned from."""

from collections.abc import Iterable, Mapping

import numpy as np

from voxdepth.baselines.learned import Learned
from voxdepth.metrics import Share, is_correct
from voxdepth.metrics.pixels import judged_pixels
from voxdepth.networks import Network
from voxdepth.paper.inpainting import convex_by
from voxdepth.types import FloatImage, Frame, Intrinsics, MaskImage

from .clips import Clip
from .samples import RATE_HZ
from .templates import template_of

WARM_UP_FRAMES = 3
DIGITS = 4

Figures = Mapping[str, float]
"""How good a network is, by names."""


def corrector_figures(network: Network, clips: Iterable[Clip]) -> Figures:
    """The shares of right pixels in the holes of the measurement, and where there is one."""
    right = {"right_in_holes": Share(), "right_where_measured": Share()}
    for clip in clips:
        corrector = Learned(clip.intrinsics, network)
        for index, (gray, raw_m, true_m) in enumerate(zip(clip.gray, clip.raw_m, clip.true_m, strict=True)):
            depth_m = corrector.process(Frame(stamp_s=index / RATE_HZ, gray=gray, depth_m=raw_m)).depth_m
            if index >= WARM_UP_FRAMES:
                for name, mask in zip(right, (raw_m == 0, raw_m > 0), strict=True):
                    right[name] += _right(depth_m, true_m, mask, clip.intrinsics)
    return _values(right)


def convex_figures(network: Network, clips: Iterable[Clip]) -> Figures:
    """The share of right pixels among those that the network fills in the templates."""
    right = {"right_where_filled": Share()}
    for clip in clips:
        template = template_of(clip)
        dense_m = convex_by(network, template.sparse_m)
        filled = (dense_m > 0) & (template.sparse_m == 0)
        right["right_where_filled"] += _right(dense_m, template.true_m, filled, clip.intrinsics)
    return _values(right)


def _right(depth_m: FloatImage, true_m: FloatImage, mask: MaskImage, camera: Intrinsics) -> Share:
    """The right pixels among those of a mask that have a true surface; one without a depth is wrong."""
    judged = judged_pixels(true_m, mask)
    given = judged & (depth_m > 0)
    right = is_correct(depth_m[given], true_m[given], camera.focal_baseline_px_m)
    return Share(hits=int(np.count_nonzero(right)), of=int(np.count_nonzero(judged)))


def _values(shares: Mapping[str, Share]) -> Figures:
    return {name: round(share.value or 0.0, DIGITS) for name, share in shares.items()}
