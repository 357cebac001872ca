"""Configuration of the paper's method."""

from typing import Literal

import numpy as np
from pydantic import Field, field_validator

from ..devices import DeviceName
from ..model import Model
from .voxels import LARGEST_EXTENT_M, VoxelConfig

NEAR_SHARE = 0.5
"""Share of the template's depth below which a pixel is too near. Paper: "less than half"."""
LARGEST = float(np.finfo(np.float32).max)


class VoxDepthConfig(Model):
    """What the paper or its authors' code sets, the grid and the device; the defaults are the paper's.

    All other numbers of the method are constants beside their use.
    """

    window_frames: int = Field(default=10, ge=1, le=1_000)
    """Frames that are fused at the start of an epoch, n in the paper. More fill more and smear more."""
    max_epoch_frames: int = Field(default=60, ge=1, le=1_000_000)
    """Frames after which an epoch ends even if registration still succeeds."""
    fusion_lag_frames: int = Field(default=3, ge=0)
    """Frames from the last of a window to the first that its template corrects, while fusion runs in the background: 3
    frames are 100 ms at 30 Hz, slightly more than a fusion takes. 0 waits for it within the call."""
    voxels: VoxelConfig = VoxelConfig()
    dilation_px: int = Field(default=5, ge=1, le=99)
    """Window whose farthest depth makes the projected cloud dense (Eq. dilate); odd. A larger one closes wider gaps and
    moves edges by half of it."""
    registration_px: int = Field(default=200, ge=64, le=4_096)
    """Width and height that gray images are resized to for registration. Paper: 200 x 200. Larger is slower."""
    n_features: int = Field(default=200, ge=10, le=100_000)
    """Maximum number of features per image. More follow the template for longer; the time grows more than linearly."""
    max_distance: int = Field(default=20, ge=0, le=256)
    """Hamming distance up to which a match is good. Paper: 20 (whose "exceeds" can only mean "at most")."""
    min_matches: int = Field(default=5, ge=3, le=100_000)
    """Good matches below which the template no longer fits the scene. Paper: 5."""
    chained: bool = False
    """Whether the map to a frame is composed of those between successive frames since the template. Neighbours match
    where the template no longer does, but the errors of the maps add up. From the authors' code, not the paper."""
    only_empty: bool = False
    """Whether only empty pixels are replaced. Otherwise those are, too, that are much nearer than the template, which
    also erases objects that move in front of it, or farther, which also overwrites surfaces that recede."""
    empty_from_m: float = Field(default=LARGEST_EXTENT_M, gt=0)
    """Depth from which a measured pixel counts as empty [m]. The default is beyond every measurement."""
    median_size_px: Literal[1, 3, 5] = 5
    """Window of the median filter against flicker; 1 is off."""
    device: DeviceName = "cpu"
    """What fuses and projects voxels: `cpu`, `cuda`, or `warp-cpu` (the kernels of `cuda` without a GPU). Frames are
    corrected on the CPU."""

    @field_validator("dilation_px")
    @classmethod
    def _require_middle(cls, size_px: int) -> int:
        if size_px % 2 == 0:
            raise ValueError("the window must be odd, so that it has a pixel in its middle")
        return size_px

    @property
    def bounds(self) -> tuple[float, float, float]:
        """Bounds of the template t that keep a depth z: `low z <= t <= high z`, and the depth of empty pixels [m].

        An empty pixel is never kept.
        """
        low, high = (0.0, LARGEST) if self.only_empty else (1.0, 1 / NEAR_SHARE)
        return low, high, self.empty_from_m

    @property
    def warm_up_frames(self) -> int:
        """Frames until a fused template is there and was used: a window, its lag, and two more."""
        return self.window_frames + self.fusion_lag_frames + 2


def authors_config() -> VoxDepthConfig:
    """Return the parameters of the public code of the paper's authors, where it differs from the paper.

    It fills only what is empty, chains the registration, asks for more and better matches, has longer windows and
    epochs, and stops while it fuses. Its "erosion" takes the maximum of a window of 5 pixels: our dilation.
    Source: `configs/configs.txt`, `voxel.cpp` and `voxel.cu` of https://github.com/Akanksha-Dixit/Voxdepthcode.
    """
    return VoxDepthConfig(
        window_frames=12,
        max_epoch_frames=200,
        fusion_lag_frames=0,
        n_features=1000,
        max_distance=10,
        min_matches=20,
        chained=True,
        only_empty=True,
        empty_from_m=65.0,
    )
