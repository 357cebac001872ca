"""A network as a baseline: an encoder and a decoder with gates, which fills and smooths disparity from frame to frame.

It stands for DeepSmooth (Krishna and Vandrotti, CVPR workshops 2023), whose weights are not public. What differs: one
encoder of a tenth of a million parameters instead of two branches; the previous result is moved by optical flow instead
of encoded again; and the loss is the likelihood of the true disparity, from which the confidence follows.
"""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from ..arithmetic import exp
from ..compiled import compile_all
from ..corrector import StreamCorrector
from ..networks import ImageBatch, Network, load
from ..temporal.fusion import PixelClass
from ..temporal.masks import above
from ..temporal.measurement import Measurement, measure
from ..temporal.upsampling import DisparityEstimate, Upsampler
from ..temporal.working_resolution import MIN_DISPARITY_PX, WorkingResolution, default_decimation, require_large
from ..types import CORRECT_PX, CORRECT_SHARE, CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics
from .realsense import fill_from_left

MULTIPLE_PX = 32
"""The network takes images whose sides are multiples of this."""
GRAY_RANGE = np.float32(255)
LARGEST_RATIO = np.float32(100)
"""Disparities of a larger multiple of the typical one look like this to the network."""
TURNS = (0, 2, 1, 3)
"""Quarter turns to the left that bring to the left what is at the left, at the right, above and below."""
LARGEST_OVERRULING_SCALE = np.float32(0.2)
"""Largest scale of the relative error of a prediction that replaces a measurement. Images unlike those of the training
get larger scales, and keep their measurements. A smaller bound keeps more of them, right and wrong ones."""
REMEMBERED_CONFIDENCE = 0.5
"""Least confidence of a previous result that may count as the origin of a filled pixel."""

SMALLEST_PX = 96
"""Smaller images get a border for the optical flow: OpenCV refuses those below 12 pixels, and crashes on some that are
long and narrow."""
LAST_PX = 32767
"""Columns and rows are given to OpenCV in 16 bits."""

Landing = npt.NDArray[np.int16]
FlowImage = npt.NDArray[np.float32]


class LearnedPrediction(NamedTuple):
    """The result for one frame at the working resolution, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 = unknown."""
    confidence: FloatImage
    """Probability that the prediction is right; also where a measurement stays instead."""


class Learned(StreamCorrector):
    """Predicts the disparity of every pixel, and the scale of its error, from the frame and the previous result.

    Measuring and showing are those of the default method, at the same working resolution. What is shown lies between
    the smallest and the largest disparity that was measured or remembered.

    Args:
        intrinsics: Intrinsics of the camera, whose images have at least `MIN_SIDE_PX` pixels a side.
        network: A network in place of the one of the library.

    Raises:
        ConfigError: The images are too small; or the network cannot be loaded, see `networks.load`.
    """

    def __init__(self, intrinsics: Intrinsics, network: Network | None = None) -> None:
        require_large(intrinsics, "the corrector 'learned'")
        self._network = network or load("corrector")
        self._resolution = WorkingResolution.of(intrinsics, default_decimation(intrinsics))
        self._upsampler = Upsampler(intrinsics.shape, self._resolution)
        self._flow = optical_flow()
        compile_all()
        super().__init__(intrinsics, network)

    def _forget(self) -> None:
        self._last: tuple[GrayImage, LearnedPrediction] | None = None

    def _align(self, frame: Frame) -> tuple[Frame, DisparityEstimate]:
        """Measure, move the previous result, and predict. The result is remembered for the next frame."""
        measurement = measure(frame, self._resolution)
        previous, gray_change = self._moved(measurement.gray)
        scale_px = typical_disparity(measurement.disparity_px, previous.disparity_px)
        if scale_px == 0:
            result = LearnedPrediction(np.zeros_like(measurement.disparity_px), np.zeros_like(measurement.disparity_px))
        else:
            images = network_input(measurement, previous, gray_change, scale_px)
            disparity, log_scale = self._network.run(images)
            result = interpreted(disparity, log_scale, scale_px, measurement.disparity_px, previous.disparity_px)
        self._last = measurement.gray, result
        pixel_class = origin(measurement.disparity_px, previous, result)
        return frame, DisparityEstimate(result.disparity_px, pixel_class, result.confidence)

    def combine(self, aligned: tuple[Frame, DisparityEstimate]) -> CorrectedDepth:
        """Show the result at the resolution of the frame."""
        frame, estimate = aligned
        return CorrectedDepth(**self._upsampler.show(frame.depth_m, estimate)._asdict())

    def _moved(self, gray: GrayImage) -> tuple[LearnedPrediction, GrayImage]:
        """Return the last result as seen from this frame, and the change of gray value; zeros without one."""
        if self._last is None:
            return LearnedPrediction(*np.zeros((2, *gray.shape), np.float32)), np.zeros_like(gray)
        last_gray, last = self._last
        landing = landing_in(last_gray, gray, self._flow)
        moved = LearnedPrediction(taken(last.disparity_px, landing), taken(last.confidence, landing))
        return moved, np.asarray(cv2.absdiff(gray, taken(last_gray, landing)), np.uint8)


def _padded(gray: GrayImage) -> GrayImage:
    """Pad to the minimum size of DIS by repeating the last row and column."""
    below, right = (max(SMALLEST_PX - side, 0) for side in gray.shape)
    return np.pad(gray, ((0, below), (0, right)), mode="edge") if below or right else gray


def optical_flow() -> cv2.DISOpticalFlow:
    """Return inverse search with refinement: Kroeger et al. 2016, DOI 10.1007/978-3-319-46493-0_29.

    The result depends a little on OpenCV's number of threads.
    """
    return cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST)


def landing_in(last_gray: GrayImage, gray: GrayImage, flow: cv2.DISOpticalFlow) -> Landing:
    """Return column and row in the last image of each pixel, (h, w, 2), by optical flow between the halved images."""
    height, width = gray.shape
    half = max(1, width // 2), max(1, height // 2)
    start, end = (
        np.asarray(cv2.resize(image, half, interpolation=cv2.INTER_AREA), np.uint8) for image in (gray, last_gray)
    )
    half_flow_px: Any = flow.calc(_padded(start), _padded(end), None)  # type: ignore[call-overload]
    half_flow_px = np.ascontiguousarray(half_flow_px[: half[1], : half[0]])
    flow_px = np.asarray(cv2.resize(half_flow_px, (width, height)), np.float32)
    return landing_of(flow_px * np.array([width / half[0], height / half[1]], np.float32))


def landing_of(flow_px: FlowImage) -> Landing:
    """Return column and row that each pixel flows to, shape (H, W, 2); outside of the image if it leaves it."""
    height, width = flow_px.shape[:2]
    landing = flow_px.copy()
    landing[..., 0] += np.arange(width, dtype=np.float32)
    landing[..., 1] += np.arange(height, dtype=np.float32)[:, None]
    return np.rint(np.clip(landing, -1, np.float32(LAST_PX), out=landing), out=landing).astype(np.int16)


def taken(image: Any, landing: Landing) -> Any:
    """Return the pixels of an image at the targets, without interpolation; 0 outside of it."""
    return cv2.remap(image, landing, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # type: ignore[call-overload]


def typical_disparity(measured_px: FloatImage, previous_px: FloatImage) -> np.float32:
    """Return the mean of the measured disparities, or else of the previous ones [px]; 0 without any.

    The network sees multiples of it, so that a scene that is twice as far is filled twice as far.
    """
    for disparity_px in (measured_px, previous_px):
        known = np.count_nonzero(disparity_px)
        if known:
            return max(MIN_DISPARITY_PX, np.float32(disparity_px.sum(dtype=np.float64) / known))
    return np.float32(0)


def network_input(
    measurement: Measurement, previous: LearnedPrediction, gray_change: GrayImage, scale_px: np.float32
) -> ImageBatch:
    """Return the images of the network, shape (1, 10, h', w'): sides are padded to `MULTIPLE_PX` with what is unknown.

    They are measured disparity in units of the scale, validity, gray value, the previous disparity and its confidence,
    the change of gray value, and the disparities that are measured next along the row and the column.

    Args:
        measurement: That of the frame, images of shape (h, w).
        previous: The previous result as seen from this frame, images of shape (h, w).
        gray_change: Absolute change of the gray value since the previous frame, shape (h, w), uint8.
        scale_px: Unit of the disparities, see `typical_disparity`; above 0.
    """
    height, width = measurement.gray.shape
    padded = (-(-height // MULTIPLE_PX) * MULTIPLE_PX, -(-width // MULTIPLE_PX) * MULTIPLE_PX)
    images = np.zeros((1, 6 + len(TURNS), *padded), np.float32)
    inner = images[0, :, :height, :width]
    largest_px = LARGEST_RATIO * scale_px
    measured_px = np.minimum(measurement.disparity_px, largest_px)
    np.divide(measured_px, scale_px, out=inner[0])
    np.greater(measured_px, 0, out=inner[1])
    np.divide(measurement.gray, GRAY_RANGE, out=inner[2])
    np.divide(np.minimum(previous.disparity_px, largest_px), scale_px, out=inner[3])
    inner[4] = previous.confidence
    np.divide(gray_change, GRAY_RANGE, out=inner[5])
    np.divide(next_measured(measured_px), scale_px, out=inner[6:])
    return images


def next_measured(disparity_px: FloatImage) -> FloatImage:
    """Return the measured disparity next to the left, right, above and below, shape (4, h, w); 0 without any.

    That of a measured pixel is its own in all directions.
    """
    beside_px = np.empty((len(TURNS), *disparity_px.shape), np.float32)
    for side_px, turns in zip(beside_px, TURNS, strict=True):
        turned_px = np.array(np.rot90(disparity_px, turns), order="C")
        fill_from_left(turned_px)
        side_px[:] = np.rot90(turned_px, -turns)
    return beside_px


def interpreted(
    disparity: ImageBatch, log_scale: ImageBatch, scale_px: np.float32, measured_px: FloatImage, previous_px: FloatImage
) -> LearnedPrediction:
    """Return the outputs of the network as disparity within that of the inputs, and the probability that it is right.

    A measured pixel keeps its measurement where the scale exceeds `LARGEST_OVERRULING_SCALE`. Its confidence is then
    still that of the prediction, which is low.

    The logarithm of disparity errs as a Laplace distribution of scale b, so that the probability of an error of at most
    t is 1 - exp(-t / b).

    Args:
        disparity: Output of the network in units of the scale, shape (1, 1, h', w').
        log_scale: Its logarithm of the scale b of the error, shape (1, 1, h', w').
        scale_px: Unit of the disparities, as for `network_input`.
        measured_px: Measured disparity, shape (h, w); 0 = invalid.
        previous_px: Previous disparity as seen from this frame, shape (h, w); 0 = unknown.
    """
    height, width = measured_px.shape
    log_scale = log_scale[0, 0, :height, :width]
    low_px, high_px = _range(measured_px, previous_px)
    disparity_px = np.clip(disparity[0, 0, :height, :width] * scale_px, low_px, high_px)
    tolerance = np.maximum(
        np.float32(CORRECT_SHARE), np.float32(CORRECT_PX) / np.maximum(disparity_px, MIN_DISPARITY_PX)
    )
    confidence = np.float32(1) - exp(-tolerance * exp(-log_scale)).astype(np.float32)
    stands = (measured_px > 0) & (log_scale > math.log(LARGEST_OVERRULING_SCALE))
    return LearnedPrediction(np.where(stands, measured_px, disparity_px), confidence)


def _range(measured_px: FloatImage, previous_px: FloatImage) -> tuple[np.float32, np.float32]:
    """Return the smallest and the largest disparity of both, of which at least one has any."""
    known = [disparity_px for disparity_px in (measured_px, previous_px) if disparity_px.any()]
    ends_px = [cv2.minMaxLoc(disparity_px, above(disparity_px, 0))[:2] for disparity_px in known]
    return np.float32(min(low for low, _ in ends_px)), np.float32(max(high for _, high in ends_px))


def origin(measured_px: FloatImage, previous: LearnedPrediction, result: LearnedPrediction) -> GrayImage:
    """Return one `PixelClass` per pixel: an unmeasured one is remembered where it is right if the previous result was.

    That is where the previous result was confident, and the new one differs from it by no more than a right depth may.
    """
    tolerance_px = np.maximum(np.float32(CORRECT_SHARE) * result.disparity_px, np.float32(CORRECT_PX))
    agrees = np.abs(result.disparity_px - previous.disparity_px) <= tolerance_px
    remembered = agrees & (previous.confidence >= REMEMBERED_CONFIDENCE)
    unmeasured = np.where(remembered, np.uint8(PixelClass.REMEMBERED), np.uint8(PixelClass.UNMEASURED))
    return np.where(measured_px > 0, np.uint8(PixelClass.FUSED), unmeasured)
