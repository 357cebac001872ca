"""The configuration of the corrector, put together from those of its parts."""

from pydantic import Field, model_validator

from .model import Model
from .odometry import OdometryConfig
from .registration import RegistrationConfig
from .voxels import VoxelConfig


class VoxDepthConfig(Model):
    """All parameters of `VoxDepth`. The defaults are the paper's."""

    window_frames: int = Field(10, ge=1)
    """Frames that are fused at the start of an epoch, n in the paper. More fill more and smear more."""
    max_epoch_frames: int = Field(60, ge=1)
    """Frames after which an epoch ends even if registration still succeeds."""
    voxels: VoxelConfig = VoxelConfig()
    odometry: OdometryConfig = OdometryConfig()
    registration: RegistrationConfig = RegistrationConfig()
    inpaint_size_px: int = 5
    """Window of the dilation that makes the template dense; odd."""
    median_size_px: int = 5
    """Window of the median filter against flicker: 1 (off), 3 or 5."""

    @model_validator(mode="after")
    def _check(self) -> "VoxDepthConfig":
        if self.inpaint_size_px < 1 or self.inpaint_size_px % 2 == 0:
            raise ValueError(f"inpaint_size_px must be odd and at least 1, got {self.inpaint_size_px}")
        if self.median_size_px not in (1, 3, 5):
            raise ValueError(f"median_size_px must be 1, 3 or 5, got {self.median_size_px}")
        return self

    @classmethod
    def paper(cls) -> "VoxDepthConfig":
        """The method as the paper writes it."""
        return cls()
