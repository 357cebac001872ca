"""Which pixels are judged, whether images fit together, bins of range, and which depths count as right."""

from typing import Any

import numpy as np
import numpy.typing as npt

from ..errors import FrameError
from ..types import RIGHT_PX, RIGHT_SHARE, FloatArray, FloatImage, MaskImage

RANGE_BINS_M: dict[str, tuple[float, float]] = {
    "0-2 m": (0.0, 2.0),
    "2-5 m": (2.0, 5.0),
    "5-10 m": (5.0, 10.0),
    "10-20 m": (10.0, 20.0),
    "20+ m": (20.0, np.inf),
}
"""By name, the nearest true depth that belongs to a bin and the nearest one beyond it [m]."""


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


def by_range(truth_m: FloatImage) -> dict[str, MaskImage]:
    """The pixels of each of `RANGE_BINS_M`, shape (H, W); every pixel with a true surface is in one bin.

    Args:
        truth_m: True depth [m], shape (H, W); pixels that are 0, NaN or infinite are in none.
    """
    known = truth_m > 0
    return {
        name: known & (truth_m >= np.float32(start_m)) & (truth_m < np.float32(end_m))
        for name, (start_m, end_m) in RANGE_BINS_M.items()
    }


def is_right(
    depth_m: FloatImage | FloatArray, reference_m: FloatImage | FloatArray, focal_baseline_px_m: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Where the disparity of a depth is within 5 %, or a quarter of a pixel; of the shape of the arguments.

    Surfaces of less disparity than that are right however far away they are said to be: count what is nearer.

    Args:
        depth_m: Depth [m]; > 0.
        reference_m: The truth [m], of the same shape; > 0.
        focal_baseline_px_m: Of the camera, see `Intrinsics`.
    """
    disparity_px, true_px = focal_baseline_px_m / depth_m, focal_baseline_px_m / reference_m
    return np.abs(disparity_px - true_px) <= np.maximum(RIGHT_SHARE * true_px, RIGHT_PX)
