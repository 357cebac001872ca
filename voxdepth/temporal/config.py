"""Configuration of the default method, put together from those of its parts."""

from typing import Literal

from pydantic import Field

from ..devices import DeviceName
from ..model import Model
from .fusion import EvidenceConfig
from .inpainting import FillingConfig
from .odometry import LocalisationConfig


class RigidConfig(Model):
    """All parameters of the default method."""

    localisation: LocalisationConfig = LocalisationConfig()
    evidence: EvidenceConfig = EvidenceConfig()
    memory_step: Literal["auto", 1, 2] = "auto"
    """Pixels of the image per pixel of memory along each side. 2 takes about half of the time, and costs thin things;
    `auto` takes it for images of more than 100 000 pixels."""
    hold_frames: int = Field(60, ge=0)
    """Frames without anything to go by (darkness, a covered lens) after which the memory is given up."""
    fill: Literal["guided", "none"] = "guided"
    """What becomes of pixels that neither sensor nor memory knows: `guided` fills them from their surroundings, `none`
    leaves them invalid."""
    filling: FillingConfig = FillingConfig()
    smooth_size_px: Literal[1, 3, 5, 7] = 5
    """Window of the edge-preserving smoothing; 1 switches it off."""
    smooth_noise_px: float = Field(0.3, gt=0)
    """Disparity noise that it takes away; more takes more, and rounds fine relief."""
    device: DeviceName = "cpu"
    """Where the memory is moved along with the camera. Only its disparity and weight are, so far: they go to `cuda` and
    come back with every frame, and all other steps run on the CPU."""
