"""Configuration of the default method."""

from typing import Literal

import numpy as np
from pydantic import Field

from ..model import Model

Part = Literal[
    "memory",
    "memory_in_fills",
    "previous_fill",
    "row_bonus",
    "slants",
    "lone_ends",
    "median",
    "coherence",
    "gray_change",
    "drift",
    "remembered_points",
    "relocalisation",
]
"""A part of the method that can be left out."""


class TemporalConfig(Model):
    """What users have reasons to change; all other numbers of the method are constants beside their use."""

    decimation: Literal["auto", 1, 2] = "auto"
    """Pixels of the image per working pixel along each side. 2 takes about half of the time, and loses thin objects;
    `auto` chooses it for images of more than 60 000 pixels."""
    pose_sigma_m: float = Field(default=0.01, ge=1e-6, le=1e6)
    """Standard deviation of each coordinate of the motion between two poses of the caller. More trusts the images
    more."""
    pose_sigma_deg: float = Field(default=0.3, ge=1e-6, le=1e6)
    """Standard deviation of the rotation about each axis between two poses of the caller."""
    fill: Literal["none", "likely", "all"] = "likely"
    """Which pixels without measurement and memory are inpainted: none, those that are likely enough right, or all. The
    others stay invalid."""
    min_fill_confidence: float = Field(default=0.2, ge=0, le=1)
    """Confidence that an inpainted pixel must have to be shown with `fill = "likely"`."""
    shadow_factor: float = Field(default=10.0, gt=0)
    """Factor of the weight of the background in an occlusion shadow, the strip without depth on the left of a near
    object. 1 for a projector or a second camera on the left."""
    without: Part | Literal["nothing"] = "nothing"
    """Part of the method to leave out: `memory` if the gray image shows the dots of a projector; the others are for
    ablation, see `voxdepth.temporal.ablations`."""
    smoothing_window_px: Literal[1, 3, 5, 7] = 5
    """Window of the edge-preserving smoothing; 1 disables it."""

    @property
    def min_shown_confidence(self) -> float:
        """Confidence that an inpainted pixel must have to be shown."""
        return {"none": np.inf, "likely": self.min_fill_confidence, "all": 0.0}[self.fill]

    @property
    def warm_up_frames(self) -> int:
        """Number of frames until every step has run: one to begin with, one to track the camera, and one more."""
        return 3
