"""Configuration of the default method."""

from typing import Literal

import numpy as np
from pydantic import Field

from ..model import Model
from .filling import FillingConfig
from .fusion import TemporalFusionConfig
from .odometry import VisualOdometryConfig


class TemporalConfig(Model):
    """All parameters of the default method."""

    decimation: Literal["auto", 1, 2] = "auto"
    """Pixels of the image per working pixel along each side. 2 takes about half of the time, and loses thin objects;
    `auto` chooses it for images of more than 200 000 pixels."""
    odometry: VisualOdometryConfig = VisualOdometryConfig()
    fusion: TemporalFusionConfig = TemporalFusionConfig()
    max_featureless_frames: int = Field(default=60, ge=0, le=1_000_000)
    """Consecutive frames without features (darkness, a covered lens) after which the memory is discarded."""
    fill: Literal["none", "likely", "all"] = "likely"
    """Which pixels without measurement and memory are inpainted: none, those that are likely enough right, or all. The
    others stay invalid."""
    min_fill_probability: float = Field(default=0.1, ge=0, le=1)
    """Confidence that an inpainted pixel must have to be shown with `fill = "likely"`."""
    filling: FillingConfig = FillingConfig()
    smoothing_window_px: Literal[1, 3, 5, 7] = 5
    """Window of the edge-preserving smoothing; 1 disables it."""
    smoothing_noise_px: float = Field(default=0.3, gt=0)
    """Disparity noise that the smoothing removes. More removes more, and flattens fine relief."""

    @property
    def min_shown_confidence(self) -> float:
        """Confidence that an inpainted pixel must have to be shown."""
        return {"none": np.inf, "likely": self.min_fill_probability, "all": 0.0}[self.fill]

    @property
    def warm_up_frames(self) -> int:
        """Number of frames until every step has run: one to begin with, one to track the camera, and one more."""
        return 3

    @property
    def depends_on_clock(self) -> bool:
        """Whether results depend on the speed of the machine."""
        return False
