"""What moves images of disparity to another pose, on the CPU or on a GPU."""

from typing import Protocol

from ..devices import DeviceName
from ..types import FloatArray, FloatImage, GrayImage
from .forward_warp import Moved, Reprojection
from .working_resolution import Scale


class ImageMover(Protocol):
    """`Reprojection`, or what does the same elsewhere."""

    def move(self, disparity_px: FloatImage, weight: GrayImage, T_target_source: FloatArray) -> Moved:
        """What the target camera sees of an image: see `Reprojection`."""
        ...


def create_image_mover(device: DeviceName, scale: Scale) -> ImageMover:
    """The one for a device.

    Raises:
        ConfigError: There is no such device here.
    """
    if device == "cpu":
        return Reprojection(scale)
    from .warp_forward_warp import WarpReprojection

    return WarpReprojection(scale, device=device)
