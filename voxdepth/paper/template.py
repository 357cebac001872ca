"""The template: what an epoch knows of the scene."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from .registration import Features


@dataclass(frozen=True, kw_only=True, eq=False)
class Template:
    """Dense depth of the scene as seen by the last frame of a fusion window."""

    depth: Any
    """Depth [m], shape (H, W), 0 = unknown, in the memory of the `ImageSteps` that made it."""
    features: Features
    """Of the gray image that the depth belongs to."""
    timings_s: Mapping[str, float]
    """Wall-clock time of fusing [s], by step."""
