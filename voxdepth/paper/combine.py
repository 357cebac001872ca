"""Merging a frame with the registered template: paper, Eq. depthcor."""

import cv2
import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage, Source

LARGEST = float(np.finfo(np.float32).max)


class CombineConfig(Model):
    """What makes a measured pixel invalid beside being empty. Both conditions are the paper's."""

    reject_near: bool = True
    """Whether a pixel much nearer than the template is invalid; this also erases things that move before it."""
    near_share: float = Field(0.5, gt=0, lt=1)
    """Share of the template's depth below which a pixel is too near. Paper: "less than half"."""
    reject_far: bool = True
    """Whether a pixel farther than the template is invalid; this also overwrites surfaces that recede."""


def combine(depth_m: FloatImage, raw_m: FloatImage, rule: CombineConfig, scratch_m: FloatImage) -> GrayImage:
    """Replace the invalid pixels of a frame by those of the template.

    A pixel is invalid if it is empty, or beyond a bound that `rule` sets. Where the template is empty the raw pixel
    stands. It works in place, for large new arrays would take several times as long as the work on them.

    Args:
        depth_m: Template in the frame's pixels [m], shape (H, W), 0 = unknown; overwritten with the result.
        raw_m: Measured depth [m], shape (H, W); 0 = invalid.
        rule: The bounds.
        scratch_m: Of the same shape; overwritten.

    Returns:
        One `Source` per pixel, shape (H, W).
    """
    _, high = factors(rule)
    with np.errstate(over="ignore"):
        farthest_m = np.multiply(raw_m, np.float32(high), out=scratch_m)
    nearest_m = raw_m if rule.reject_far else np.zeros_like(raw_m)
    stands: GrayImage = cv2.inRange(depth_m, nearest_m, farthest_m)  # type: ignore[assignment]
    stands[...] |= depth_m == 0
    cv2.copyTo(raw_m, stands, depth_m)
    source: GrayImage = np.uint8(Source.MEMORY) - (stands & np.uint8(1))
    source[...] *= depth_m > 0
    return source


def factors(rule: CombineConfig) -> tuple[float, float]:
    """A pixel z stands against a template t if `low z <= t <= high z`; an empty one never does."""
    return (1.0 if rule.reject_far else 0.0), (1 / rule.near_share if rule.reject_near else LARGEST)
