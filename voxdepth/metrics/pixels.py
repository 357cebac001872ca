"""Which pixels are judged, whether images fit together, and which depths count as right."""

from dataclasses import fields
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from ..errors import FrameError
from ..types import CORRECT_PX, CORRECT_SHARE, FloatArray, FloatImage, MaskImage


class Addable:
    """A dataclass of sums over pixels: two of them add up field by field."""

    def __add__(self, other: Self) -> Self:
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return type(self)(**{name: getattr(self, name) + getattr(other, name) for name in names})


def judged_pixels(truth_m: FloatImage, mask: MaskImage) -> MaskImage:
    """The pixels of a mask that have a true surface (not 0, NaN or infinite), shape (H, W).

    Raises:
        FrameError: The mask is not Boolean.
    """
    if mask.dtype != np.bool_:  # NumPy would take it for indices of rows.
        raise FrameError(f"expected a mask of type bool, got {mask.dtype}; compare the image with 0 first")
    return np.asarray(mask & (truth_m > 0) & (truth_m < np.inf))


def select_judged(
    depth_m: FloatImage, truth_m: FloatImage, mask: MaskImage
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Depth and true depth [m] of the pixels of a mask that have a true surface, both of shape (N,).

    Raises:
        FrameError: The shapes differ, or a selected depth is negative, NaN or infinite.
    """
    require_same_shape(depth_m=depth_m, truth_m=truth_m, mask=mask)
    judged = judged_pixels(truth_m, mask)
    require_depth(depth_m[judged])
    return depth_m[judged], truth_m[judged]


def require_same_shape(**images: npt.NDArray[Any]) -> None:
    """Raise a `FrameError` for images of different sizes, which NumPy might broadcast."""
    if len({image.shape for image in images.values()}) > 1:
        shapes = ", ".join(f"{name} {image.shape}" for name, image in images.items())
        raise FrameError(f"expected images of one shape (H, W), got {shapes}")


def require_depth(depth_m: npt.NDArray[np.floating[Any]]) -> None:
    """Raise a `FrameError` for depths that are negative, NaN or infinite, which a mean would hide."""
    wrong = depth_m.size - int(np.count_nonzero((depth_m >= 0) & (depth_m < np.inf)))
    if wrong:
        raise FrameError(
            f"expected depth in metres, finite and 0 where invalid, got {wrong} judged pixels that are not"
        )


def is_correct(
    depth_m: FloatImage | FloatArray, reference_m: FloatImage | FloatArray, focal_baseline_px_m: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Whether the error of a disparity is at most 5 % or a quarter of a pixel; same shape as the arguments.

    All depths [m] must be positive. A far surface with a disparity below a quarter of a pixel is right at any larger
    depth. `focal_baseline_px_m` is the property of `Intrinsics`.
    """
    disparity_px, true_px = focal_baseline_px_m / depth_m, focal_baseline_px_m / reference_m
    return np.abs(disparity_px - true_px) <= np.maximum(CORRECT_SHARE * true_px, CORRECT_PX)
