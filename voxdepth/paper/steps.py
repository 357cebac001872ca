"""The image work of the corrector, step by step, on the CPU or on a GPU."""

from typing import Any, Protocol

from ..devices import DeviceName, require_device
from ..types import FloatArray, FloatImage, GrayImage, Intrinsics
from .config import PaperConfig


class ImageSteps(Protocol):
    """The steps that touch every pixel. Images pass from one to the next in whatever memory an implementation uses."""

    def clear(self) -> None:
        """Empty the voxel grid."""
        ...

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """OR the voxels of a depth image, shape (H, W), taken at a pose in the grid's frame, into the grid."""
        ...

    def project(self) -> Any:
        """Sparse depth of the grid's voxels in the camera at its origin."""
        ...

    def inpaint(self, sparse: Any) -> Any:
        """Dense depth of sparse depth."""
        ...

    def upload(self, depth_m: FloatImage) -> Any:
        """A depth image [m], shape (H, W), in this object's memory."""
        ...

    def warp(self, template: Any, M_frame_template: FloatArray) -> Any:
        """The template in the pixels of the frame, sampled at the nearest pixel; 0 beside it."""
        ...

    def combine(self, raw: Any, template: Any) -> tuple[Any, Any]:
        """Depth and `Source` after the invalid pixels of a frame are replaced by those of the warped template."""
        ...

    def unchanged(self, raw: Any) -> tuple[Any, Any]:
        """Depth and `Source` of a frame without a template."""
        ...

    def filter(self, depth: Any) -> Any:
        """Median filter against flicker."""
        ...

    def download(self, depth: Any, source: Any) -> tuple[FloatImage, GrayImage]:
        """Depth [m] and `Source`, shape (H, W), as NumPy arrays of their own."""
        ...


def create_steps(device: DeviceName, intrinsics: Intrinsics, config: PaperConfig) -> ImageSteps:
    """The steps on a device.

    Raises:
        ConfigError: There is no such device here.
    """
    if device == "cpu":
        from .host_steps import HostSteps

        return HostSteps(intrinsics, config)
    from .warp_steps import WarpSteps

    require_device(device)
    return WarpSteps(intrinsics, config, device=device)
