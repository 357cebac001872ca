"""Which pixels are judged, and whether the images fit together at all."""

from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FrameError
from ..types import FloatImage, MaskImage


def judged_pixels(truth_m: FloatImage, mask: MaskImage) -> MaskImage:
    """The pixels of a mask that have a true surface, shape (H, W).

    Args:
        truth_m: True depth [m], shape (H, W); 0, NaN or infinite where no surface is known.
        mask: Pixels asked for, shape (H, W).

    Raises:
        FrameError: The mask is not Boolean.
    """
    require_mask(mask)
    return np.asarray(mask & (truth_m > 0) & (truth_m < np.inf))


def require_mask(mask: npt.NDArray[Any]) -> None:
    """Refuse a mask that is not Boolean, with which NumPy would select rows by number.

    Raises:
        FrameError: Its type is another.
    """
    if mask.dtype != np.bool_:
        raise FrameError(f"expected a mask of type bool, got {mask.dtype}; compare the image with 0 first")


def require_same_shape(**images: npt.NDArray[Any]) -> None:
    """Refuse images of different sizes, which NumPy might spread over one another.

    Raises:
        FrameError: The shapes differ.
    """
    if len({image.shape for image in images.values()}) > 1:
        shapes = ", ".join(f"{name} {image.shape}" for name, image in images.items())
        raise FrameError(f"expected images of one shape (H, W), got {shapes}")


def require_depth(depth_m: npt.NDArray[np.floating[Any]]) -> None:
    """Refuse what is no depth; averaged in, it would hide in a figure.

    Raises:
        FrameError: A pixel is negative, NaN or infinite.
    """
    wrong = depth_m.size - int(np.count_nonzero((depth_m >= 0) & (depth_m < np.inf)))
    if wrong:
        raise FrameError(
            f"expected depth in metres, finite and 0 where invalid, got {wrong} judged pixels that are not"
        )
