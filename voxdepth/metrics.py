"""Metrics of depth against the true depth, over explicit masks. The true depth never reaches a corrector.

Depth errors are sums over pixels, so that frames, masks and sequences of any size add up to one figure.
"""

import math
from dataclasses import dataclass, field, fields
from itertools import product
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt

from .errors import FrameError
from .types import CORRECT_PX, CORRECT_SHARE, FloatArray, FloatImage, MaskImage

TOO_FAR = 1.1
"""A pixel is too far when it is more than 10 % beyond the truth."""
CLOSE = 0.05
"""A pixel is close if its relative error is at most this."""
BINS = 6
"""Number of equal bins of the confidence, of a reliability curve."""
BELIEVED = 0.8
"""A depth is believed if its confidence is at least this."""


class Addable:
    """A dataclass of sums over pixels: two of them add up field by field."""

    def __add__(self, other: Self) -> Self:
        names = [field.name for field in fields(self)]  # type: ignore[arg-type]
        return type(self)(**{name: getattr(self, name) + getattr(other, name) for name in names})


def evaluated_pixels(truth_m: FloatImage, mask: MaskImage) -> MaskImage:
    """Return the pixels of a mask that have a true surface (not 0, NaN or infinite), shape (H, W).

    Raises:
        FrameError: The mask is not Boolean.
    """
    if mask.dtype != np.bool_:  # NumPy would take it for indices of rows.
        raise FrameError(f"expected a mask of type bool, got {mask.dtype}; compare the image with 0 first")
    return np.asarray(mask & (truth_m > 0) & (truth_m < np.inf))


def select_evaluated(
    depth_m: FloatImage, truth_m: FloatImage, mask: MaskImage
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Return depth and true depth [m] of the pixels of a mask that have a true surface, both of shape (N,).

    Raises:
        FrameError: The shapes differ, or a selected depth is negative, NaN or infinite.
    """
    require_same_shape(depth_m=depth_m, truth_m=truth_m, mask=mask)
    evaluated = evaluated_pixels(truth_m, mask)
    require_depth(depth_m[evaluated])
    return depth_m[evaluated], truth_m[evaluated]


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


def is_close(
    depth_m: npt.NDArray[np.float32], truth_m: npt.NDArray[np.float32]
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether a depth [m] is within 5 % of the truth, same shape as both. A missing depth, 0, is not."""
    return np.asarray(np.abs(depth_m - truth_m) <= np.float32(CLOSE) * truth_m)


def is_correct(
    depth_m: FloatImage | FloatArray, reference_m: FloatImage | FloatArray, focal_baseline_px_m: float
) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether the error of a disparity is at most 5 % or a quarter of a pixel; same shape as the arguments.

    All depths [m] must be positive. A far surface with a disparity below a quarter of a pixel is right at any larger
    depth. `focal_baseline_px_m` is the property of `Intrinsics`.
    """
    disparity_px, true_px = focal_baseline_px_m / depth_m, focal_baseline_px_m / reference_m
    return np.abs(disparity_px - true_px) <= np.maximum(CORRECT_SHARE * true_px, CORRECT_PX)


@dataclass(frozen=True, kw_only=True)
class DepthErrors(Addable):
    """Sums over pixels with a true surface; errors are over the filled ones. Every figure is None without pixels."""

    pixels: int = 0
    """Pixels with a true surface that count."""
    filled: int = 0
    """Number of these pixels that have a depth."""
    abs_error_m: float = 0.0
    """Sum of |depth - truth| [m]."""
    too_far: int = 0
    """Filled pixels with depth > 1.1 truth."""

    @property
    def mae_m(self) -> float | None:
        """Mean absolute error [m]."""
        return self.mean(self.abs_error_m)

    @property
    def too_far_share(self) -> float | None:
        """Share of filled pixels more than 10 % too far, 0..1."""
        return self.mean(self.too_far)

    @property
    def hole_share(self) -> float | None:
        """Share of pixels without a depth, 0..1."""
        return 1 - self.filled / self.pixels if self.pixels else None

    def mean(self, total: float) -> float | None:
        """Return the mean over the filled pixels of a sum over them."""
        return total / self.filled if self.filled else None


def depth_errors(depth_m: FloatImage, truth_m: FloatImage, *, max_range_m: float) -> DepthErrors:
    """Sum the errors of one image [m], 0 = invalid, over the pixels whose true depth is at most `max_range_m`.

    The true depth [m] is +inf where there is no surface, and 0 where it is unknown.
    """
    evaluated = (truth_m > 0) & (truth_m <= max_range_m)
    known = evaluated & (depth_m > 0)
    depth_m, truth_m = depth_m[known], truth_m[known]
    return DepthErrors(
        pixels=int(np.count_nonzero(evaluated)),
        filled=len(depth_m),
        abs_error_m=float(np.abs(depth_m - truth_m).sum(dtype=np.float64)),
        too_far=int(np.count_nonzero(depth_m > np.float32(TOO_FAR) * truth_m)),
    )


@dataclass(frozen=True, kw_only=True)
class Sums(DepthErrors):
    """All sums that the evaluation needs. The errors hide how many pixels are filled: `coverage` says that."""

    squared_error_m2: float = 0.0
    """Sum of (depth - truth)^2 [m^2]."""
    too_near: int = 0
    """Pixels with depth < truth / 1.1; at range, mostly stereo noise."""
    close: int = 0
    """Pixels within 5 % of the truth."""

    @classmethod
    def of(cls, depth_m: FloatImage, truth_m: FloatImage, mask: MaskImage) -> "Sums":
        """Sum the errors of one image over the pixels of a mask; depth and truth [m] are 0 where invalid.

        The time is proportional to the pixels of the mask: for many masks of a frame, add the sums of disjoint ones.

        Raises:
            FrameError: See `select_evaluated`.
        """
        depth, truth = select_evaluated(depth_m, truth_m, mask)
        filled = depth > 0
        near, far = depth[filled], truth[filled]
        error_m = near.astype(np.float64) - far
        return cls(
            pixels=depth.size,
            filled=near.size,
            abs_error_m=float(np.abs(error_m).sum()),
            squared_error_m2=float(np.square(error_m).sum()),
            too_far=int(np.count_nonzero(near > np.float32(TOO_FAR) * far)),
            too_near=int(np.count_nonzero(np.float32(TOO_FAR) * near < far)),
            close=int(np.count_nonzero(is_close(near, far))),
        )

    @property
    def coverage(self) -> float | None:
        """Share of pixels that have a depth, 0..1."""
        return self.filled / self.pixels if self.pixels else None

    @property
    def rmse_m(self) -> float | None:
        """Root of the mean squared error [m]."""
        mean_squared_m2 = self.mean(self.squared_error_m2)
        return None if mean_squared_m2 is None else float(np.sqrt(mean_squared_m2))

    @property
    def too_near_share(self) -> float | None:
        """Share of filled pixels more than 10 % too near, 0..1."""
        return self.mean(self.too_near)

    def psnr_db(self, peak_m: float) -> float | None:
        """Return the peak signal-to-noise ratio `10 log10(peak^2 / mean squared error)` [dB]; inf without error.

        State the peak [m] with the figure: twice the peak adds 6 dB.
        """
        mean_squared_m2 = self.mean(self.squared_error_m2)
        return None if mean_squared_m2 is None else psnr_db(mean_squared_m2, peak_m)


def psnr_db(mean_squared_error: float, peak: float) -> float:
    """Return the peak signal-to-noise ratio [dB] of a mean squared error, in the peak's unit squared; inf without."""
    return 10 * math.log10(peak**2 / mean_squared_error) if mean_squared_error > 0 else float("inf")


@dataclass(frozen=True, kw_only=True)
class Share(Addable):
    """A share of pixels; shares of frames add up."""

    hits: int = 0
    of: int = 0

    @property
    def value(self) -> float | None:
        """The share, 0..1; None without pixels."""
        return self.hits / self.of if self.of else None


def _zeros() -> FloatArray:
    return np.zeros(BINS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Reliability(Addable):
    """How well the confidence foretells which depths are right: sums over pixels, in `BINS` equal bins of it.

    Arrays have the shape (BINS,). The last bin includes a confidence of 1.
    """

    pixels: FloatArray = field(default_factory=_zeros)
    """Number of pixels."""
    confidence: FloatArray = field(default_factory=_zeros)
    """Sum of their confidences."""
    right: FloatArray = field(default_factory=_zeros)
    """Number of them that are right, see `is_correct`."""
    believed: Share = Share()
    """Share of all pixels whose confidence is at least `BELIEVED`."""
    believed_right: Share = Share()
    """Share of these that is right."""
    squared_error: float = 0.0
    """Sum over the pixels of the squared difference of the confidence from 1 if it is right, and from 0 if not."""

    @classmethod
    def of(
        cls,
        depth_m: FloatImage,
        confidence: FloatImage,
        truth_m: FloatImage,
        mask: MaskImage,
        focal_baseline_px_m: float,
    ) -> "Reliability":
        """Sum over the pixels of a mask that have a depth and a true surface, at any range.

        Args:
            depth_m: Depth under test [m], shape (H, W); 0 = invalid.
            confidence: Probability that it is right, 0..1, shape (H, W).
            truth_m: True depth [m], shape (H, W); 0, NaN or infinite is not counted.
            mask: Pixels that count, shape (H, W).
            focal_baseline_px_m: The property of `Intrinsics`.

        Raises:
            FrameError: The shapes differ, or an evaluated depth is negative, NaN or infinite.
        """
        require_same_shape(depth_m=depth_m, confidence=confidence)
        depth, truth = select_evaluated(depth_m, truth_m, mask)
        filled = depth > 0
        said = confidence[evaluated_pixels(truth_m, mask)][filled].astype(np.float64)
        right = is_correct(depth[filled], truth[filled], focal_baseline_px_m)
        bin_index = np.minimum((said * BINS).astype(np.intp), BINS - 1)
        believed = said >= np.float32(BELIEVED)
        return cls(
            pixels=np.asarray(np.bincount(bin_index, minlength=BINS), np.float64),
            confidence=np.asarray(np.bincount(bin_index, said, BINS), np.float64),
            right=np.asarray(np.bincount(bin_index, right, BINS), np.float64),
            believed=Share(hits=int(np.count_nonzero(believed)), of=said.size),
            believed_right=Share(hits=int(np.count_nonzero(believed & right)), of=int(np.count_nonzero(believed))),
            squared_error=float(np.square(said - right).sum()),
        )

    @property
    def n(self) -> int:
        """Number of pixels."""
        return self.believed.of

    @property
    def said(self) -> float | None:
        """Mean confidence, 0..1; None without pixels."""
        return float(self.confidence.sum() / self.n) if self.n else None

    @property
    def right_share(self) -> float | None:
        """Share of right pixels, 0..1; None without pixels."""
        return float(self.right.sum() / self.n) if self.n else None

    @property
    def brier_score(self) -> float | None:
        """Mean squared error of the confidence as a forecast, 0..1, smaller is better; None without pixels.

        Unlike the calibration error, it also tells whether right depths have a higher confidence than wrong ones.
        """
        return self.squared_error / self.n if self.n else None

    @property
    def calibration_error(self) -> float | None:
        """Mean over the pixels of the difference of mean confidence and share of right ones in their bin, 0..1."""
        return float(np.abs(self.confidence - self.right).sum() / self.n) if self.n else None


EDGE_PX = 9
"""Width of the window around a pixel in which a depth edge is looked for."""
EDGE_STEP_PX = 1.0
"""Difference of disparities up to which they belong to one surface."""
EDGE_STEP_SHARE = 0.03
"""Share of the disparity that is added to that difference."""


def flying_share(depth_m: FloatImage, truth_m: FloatImage, mask: MaskImage, focal_baseline_px_m: float) -> Share:
    """Return the share of the pixels with a depth beside a depth edge that hang in the space between two surfaces.

    A pixel is beside an edge if the true disparities within `EDGE_PX` x `EDGE_PX` pixels around it span more than two
    tolerances at the largest of them. The tolerance at a disparity is `EDGE_STEP_PX` and `EDGE_STEP_SHARE` of it. A
    pixel flies if its disparity lies between the smallest and the largest of them, and differs from each by more than
    the tolerance at its own.

    Where the truth has gaps, the surface that a pixel belongs to may be missing in the window.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid, not counted.
        truth_m: True depth [m], shape (H, W); 0, NaN or infinite is unknown.
        mask: Pixels that are evaluated, if they have a true depth, shape (H, W).
        focal_baseline_px_m: The property of `Intrinsics`.

    Raises:
        FrameError: See `select_evaluated`.
    """
    select_evaluated(depth_m, truth_m, mask)
    known = evaluated_pixels(truth_m, np.ones_like(mask))
    scale = np.float32(focal_baseline_px_m)
    true_px = np.divide(scale, truth_m, out=np.zeros_like(truth_m), where=known)
    window = np.ones((EDGE_PX, EDGE_PX), np.uint8)
    high_px = np.asarray(cv2.dilate(true_px, window), np.float32)
    true_px[~known] = np.inf  # Unknown pixels are 0 for the maximum, and infinite for the minimum.
    low_px = np.asarray(cv2.erode(true_px, window), np.float32)
    beside = known & mask & (depth_m > 0)
    beside[beside] = high_px[beside] - low_px[beside] > 2 * _tolerance_px(high_px[beside])
    row, col = np.nonzero(beside)
    own_px = scale / depth_m[beside]
    between = (low_px[beside] < own_px) & (own_px < high_px[beside])
    row, col, own_px = row[between], col[between], own_px[between]
    around_px = np.pad(true_px, EDGE_PX // 2, constant_values=np.float32(np.inf))
    tolerance_px, flying = _tolerance_px(own_px), np.ones(own_px.shape, np.bool_)
    for i, j in product(range(EDGE_PX), repeat=2):
        flying &= np.abs(around_px[row + i, col + j] - own_px) > tolerance_px
    return Share(hits=int(np.count_nonzero(flying)), of=int(np.count_nonzero(beside)))


def _tolerance_px(disparity_px: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return np.float32(EDGE_STEP_PX) + np.float32(EDGE_STEP_SHARE) * disparity_px


def ghost_share(depth_m: FloatImage, truth_m: FloatImage, departed_m: FloatImage) -> Share:
    """Return the share of the filled pixels that an object has left which still show it.

    A ghost is nearer to the departed object than to the background: its depth is below their geometric mean. "10 % too
    near" would mostly count stereo noise. Judge it together with `Sums.coverage` and `Sums.too_far_share`: a
    method that fills nothing, or fills with the farthest depth, has no ghosts.

    Args:
        depth_m: Depth under test [m], shape (H, W); 0 = invalid, not counted.
        truth_m: True depth of what is there now, the background [m]; 0, NaN or infinite is not counted.
        departed_m: Depth that the object had at the pixel when it was there [m]; 0 where it was not. Pixels where it
            would be at or behind the background are not counted.

    Raises:
        FrameError: See `select_evaluated`.
    """
    require_same_shape(depth_m=depth_m, truth_m=truth_m, departed_m=departed_m)
    left = (departed_m > 0) & (departed_m < truth_m) & (truth_m < np.inf)
    depth, background = select_evaluated(depth_m, truth_m, left)
    object_m = departed_m[left]
    filled = depth > 0
    ghosts = filled & (np.square(depth.astype(np.float64)) < background.astype(np.float64) * object_m)
    return Share(hits=int(np.count_nonzero(ghosts)), of=int(np.count_nonzero(filled)))


def survival(depth_m: FloatImage, truth_m: FloatImage, moving: MaskImage) -> Share:
    """Return the share of a moving object's pixels whose depth is within 5 % of the truth; a hole does not survive.

    The sensor misses some pixels as well: compare the share with that of the raw depth of the same frames.

    Raises:
        FrameError: See `select_evaluated`.
    """
    depth, truth = select_evaluated(depth_m, truth_m, moving)
    return Share(hits=int(np.count_nonzero(is_close(depth, truth))), of=depth.size)


class Flicker:
    """Accumulates `|e_t - e_(t-1)|` at the same pixel, where e is depth minus truth.

    The motion of the camera does not count as flicker, since the true depth is subtracted. A pixel counts if it is
    static, and has a true surface and a depth in both frames.
    """

    def __init__(self) -> None:
        self.changes = 0
        """Number of pixels that count, of all frames so far."""
        self._change_m = 0.0
        self._error_m: FloatArray | None = None
        """Error of the last frame [m], shape (H, W); NaN where it has no true surface or no depth."""

    @property
    def mean_change_m(self) -> float | None:
        """Mean change of the error from one frame to the next [m]; None when no pixel counts."""
        return self._change_m / self.changes if self.changes else None

    def add(self, depth_m: FloatImage, truth_m: FloatImage, static: MaskImage) -> None:
        """Add depth and true depth [m] of the next frame, 0 = invalid; all images have the shape (H, W).

        Args:
            depth_m: Depth under test.
            truth_m: True depth; pixels that are 0, NaN or infinite do not count.
            static: Pixels that show the same surface as in the frame before; unused for the first frame.

        Raises:
            FrameError: The shapes differ, or the depth of a pixel with a true surface is negative, NaN or infinite.
        """
        require_same_shape(depth_m=depth_m, truth_m=truth_m, static=static)
        known = evaluated_pixels(truth_m, np.ones_like(static))
        require_depth(depth_m[known])
        error_m = np.full(depth_m.shape, np.nan)
        np.subtract(depth_m, truth_m, out=error_m, where=known & (depth_m > 0), dtype=np.float64)
        if self._error_m is not None:
            require_same_shape(depth_m=error_m, previous_depth_m=self._error_m)
            change_m = np.abs(error_m - self._error_m)[static]
            change_m = change_m[np.isfinite(change_m)]
            self.changes += change_m.size
            self._change_m += float(change_m.sum())
        self._error_m = error_m
