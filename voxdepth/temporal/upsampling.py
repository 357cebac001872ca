"""The output of the method: depth, source and confidence of every pixel of the frame, from its working pixel."""

import weakref
from typing import Generic, NamedTuple, TypeVar

import cv2
import numpy as np
import numpy.typing as npt
from numba import float32, uint8, void
from numba.types import UniTuple

from ..arithmetic import without_ipp
from ..compiled import (
    BYTE_IMAGE,
    BYTE_ROW,
    FLOAT_IMAGE,
    FLOAT_ROW,
    READABLE_IMAGE,
    compiled,
    compiled_part,
    named_tuple,
)
from ..geometry import fill_from_nearest
from ..types import FloatImage, GrayImage, Source
from .fusion import PixelClass
from .rays import PIXEL_INDICES, PixelIndices
from .working_resolution import MAX_DISPARITY_PX, MIN_DISPARITY_PX, WorkingResolution, depth_of, disparity_of

KERNEL = np.ones((3, 3), np.uint8)
MAX_SURFACE_SPAN_PX = np.float32(1)
"""Span of disparity over 3 x 3 px up to which disparity is interpolated. Pixels that span more lie at a
discontinuity."""
TOLERANCE_PX = np.float32(1)
RELATIVE_TOLERANCE = np.float32(0.02)
"""A full pixel whose measurement differs by more from its working pixel shows another surface."""
NO_VOTE = np.float32(0.01)
"""Confidence of a pixel that nothing votes for."""
MAX_FREE = 4
"""Images whose memory is kept for later ones."""
Scalar = TypeVar("Scalar", bound=np.generic)
Slices = slice | tuple[slice, slice]


class DisparityEstimate(NamedTuple):
    """What is known of the working pixels, shape (h, w)."""

    disparity_px: FloatImage
    """Disparity; 0 = unknown."""
    pixel_class: GrayImage
    """One `PixelClass` per pixel."""
    confidence: FloatImage


class OutputImages(NamedTuple):
    """The output for the pixels of the frame, shape (H, W); see `CorrectedDepth`."""

    depth_m: FloatImage
    source: GrayImage
    confidence: FloatImage


ESTIMATE_TYPE = named_tuple(DisparityEstimate, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)
SHOWN_TYPE = named_tuple(OutputImages, FLOAT_IMAGE, BYTE_IMAGE, FLOAT_IMAGE)


class ImagePool(Generic[Scalar]):
    """Lends images of one shape and type.

    The system provides new memory page by page at its first use, which takes longer than to fill an image: of the
    default method's 7.3 ms for a frame of 640 x 480 it would be one more.
    """

    def __init__(self, shape: tuple[int, ...], dtype: type[Scalar]) -> None:
        self._shape = shape
        self._dtype = dtype
        self._free: list[npt.NDArray[Scalar]] = []

    def image(self) -> npt.NDArray[Scalar]:
        """Return an image without values yet."""
        memory = self._free.pop() if self._free else np.empty(self._shape, self._dtype)
        # The base of the image and of all its views, since that of this array is none.
        flat = np.frombuffer(memory.data, self._dtype)
        weakref.finalize(flat, self._take_back, memory)
        return flat.reshape(self._shape)

    def _take_back(self, memory: npt.NDArray[Scalar]) -> None:
        if len(self._free) < MAX_FREE:
            self._free.append(memory)


class Upsampler:
    """Makes the output for frames of one size from the working pixels."""

    def __init__(self, shape: tuple[int, int], resolution: WorkingResolution) -> None:
        self._resolution = resolution
        self._floats, self._bytes = ImagePool(shape, np.float32), ImagePool(shape, np.uint8)

    def show(
        self, measured_m: FloatImage, estimate: DisparityEstimate, min_fill_confidence: float = 0.0
    ) -> OutputImages:
        """Return the output for a frame of that measured depth, shape (H, W), 0 = invalid.

        At half resolution, disparity is interpolated on surfaces. At depth discontinuities, each full pixel keeps its
        measurement if it is of the same surface, and otherwise takes its working pixel without interpolation.

        Inpainted pixels with a smaller confidence than `min_fill_confidence` are not shown.
        """
        shown = OutputImages(self._floats.image(), self._bytes.image(), self._floats.image())
        measured_m, resolution = np.ascontiguousarray(measured_m), self._resolution
        focal_baseline_px_m = resolution.focal_baseline_px_m
        disparity_px = estimate.disparity_px
        if resolution.decimation == 2:
            span_px = cv2.morphologyEx(estimate.disparity_px, cv2.MORPH_GRADIENT, KERNEL)
            size = 2 * resolution.width_px, 2 * resolution.height_px
            with without_ipp():
                disparity_px = np.asarray(cv2.resize(disparity_px, size, interpolation=cv2.INTER_LINEAR), np.float32)
            _separate(measured_m, estimate, np.asarray(span_px, np.float32), focal_baseline_px_m, disparity_px)
        _show(measured_m, disparity_px, estimate, focal_baseline_px_m, min_fill_confidence, shown)
        height, width = disparity_px.shape
        if height < measured_m.shape[0]:
            _show_odd(measured_m, np.s_[height:], np.s_[height - 1 : height], shown)
        if width < measured_m.shape[1]:
            _show_odd(measured_m, np.s_[:, width:], np.s_[:, width - 1 : width], shown)
        return shown


def _show_odd(measured_m: FloatImage, last: Slices, beside: Slices, shown: OutputImages) -> None:
    """Show a last odd row or column, which has no working pixel: what it measured, and else what is beside it."""
    is_measured, depth_m, source, confidence = measured_m[last] > 0, *(image[beside] for image in shown)
    estimated = np.where(source == Source.SENSOR, np.uint8(Source.INPAINTED), source)
    shown.depth_m[last] = np.where(is_measured, measured_m[last], depth_m)
    shown.source[last] = np.where(is_measured, np.uint8(Source.SENSOR), estimated)
    shown.confidence[last] = np.where(is_measured, np.maximum(confidence, NO_VOTE), confidence)


def completed(shown: OutputImages) -> OutputImages:
    """Return the output with the nearest depth where there is none, hardly confident; an empty one stays empty."""
    depth_m = fill_from_nearest(shown.depth_m)
    is_guessed = (shown.depth_m == 0) & (depth_m > 0)
    source = np.where(is_guessed, np.uint8(Source.INPAINTED), shown.source)
    return OutputImages(depth_m, source, np.where(is_guessed, NO_VOTE, shown.confidence))


@compiled_part(UniTuple(uint8, 2)(uint8, float32, float32))
def _sources(pixel_class: int, confidence: float, min_fill_confidence: float) -> tuple[int, int]:
    """Return the source of a working pixel's measured pixels, and of the others: the sensor may have measured some.

    Without enough confidence it is `INVALID`: nothing is shown.
    """
    sensor = uint8(Source.SENSOR if confidence > 0 else Source.INVALID)
    memory = uint8(Source.MEMORY if confidence > 0 else Source.INVALID)
    fill = uint8(Source.INPAINTED if (confidence > 0) & (confidence >= min_fill_confidence) else Source.INVALID)
    is_remembered = pixel_class == PixelClass.REMEMBERED
    of_measured = fill if pixel_class == PixelClass.UNMEASURED else sensor
    of_others = memory if pixel_class == PixelClass.FUSED else fill
    return memory if is_remembered else of_measured, memory if is_remembered else of_others


@compiled(void(READABLE_IMAGE, ESTIMATE_TYPE, FLOAT_IMAGE, float32, FLOAT_IMAGE))
def _separate(
    measured_m: FloatImage,
    estimate: DisparityEstimate,
    span_px: FloatImage,
    focal_baseline_px_m: float,
    # input and output
    disparity_px: FloatImage,
) -> None:
    """Keep the surfaces apart at depth discontinuities, and the measurement where it is the estimate.

    Args:
        measured_m: Measured depth of the frame, shape (H, W); 0 = invalid.
        estimate: What is known of the working pixels, shape (h, w).
        span_px: Span of the estimated disparity in 3 x 3 working pixels, shape (h, w).
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        disparity_px: Interpolated disparity of the pixels of the frame, shape (2 h, 2 w); changed in place.
    """
    for row in range(span_px.shape[0]):
        for col in range(span_px.shape[1]):
            is_measurement = estimate.pixel_class[row, col] == PixelClass.MEASURED
            value_px = estimate.disparity_px[row, col]
            if not is_measurement and span_px[row, col] <= MAX_SURFACE_SPAN_PX:
                continue
            tolerance_px = RELATIVE_TOLERANCE * value_px + TOLERANCE_PX
            for full_row in range(2 * row, 2 * row + 2):
                for full_col in range(2 * col, 2 * col + 2):
                    measured_px = disparity_of(measured_m[full_row, full_col], focal_baseline_px_m)
                    is_same = is_measurement or abs(measured_px - value_px) < tolerance_px
                    disparity_px[full_row, full_col] = measured_px if measured_px > 0 and is_same else value_px


@compiled_part(void(BYTE_ROW, FLOAT_ROW, BYTE_ROW, FLOAT_ROW))
def _double(
    pixel_class: GrayImage,
    confidence: FloatImage,
    # output
    doubled_class: GrayImage,
    doubled_confidence: FloatImage,
) -> None:
    """Repeat each pixel of a row.

    Args:
        pixel_class: One `PixelClass` per working pixel, shape (w,).
        confidence: Its confidence, shape (w,).
        doubled_class: The class of the pixels of the frame, shape (2 w,); written.
        doubled_confidence: Their confidence, shape (2 w,); written.
    """
    for col in range(len(pixel_class)):
        left = np.uintp(2 * col)
        right = left + np.uintp(1)
        doubled_class[left] = doubled_class[right] = pixel_class[col]
        doubled_confidence[left] = doubled_confidence[right] = confidence[col]


@compiled(void(READABLE_IMAGE, FLOAT_IMAGE, ESTIMATE_TYPE, float32, float32, SHOWN_TYPE))
def _show(
    measured_m: FloatImage,
    disparity_px: FloatImage,
    estimate: DisparityEstimate,
    focal_baseline_px_m: float,
    min_fill_confidence: float,
    # output
    shown: OutputImages,
) -> None:
    """Find the output for the disparity of the pixels of the frame, each of which is in a working pixel.

    Args:
        measured_m: Measured depth of the frame, shape (H, W); 0 = invalid.
        disparity_px: Disparity of its pixels, shape (h, w) or (2 h, 2 w); 0 = unknown.
        estimate: What is known of the working pixels, shape (h, w).
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        min_fill_confidence: Least confidence of an inpainted pixel that is shown.
        shown: Images of shape (H, W); written, except for a last odd row or column.
    """
    height, width = disparity_px.shape
    is_halved, least_m = width > estimate.confidence.shape[1], focal_baseline_px_m / MAX_DISPARITY_PX
    class_row, confidence_row = np.empty(width, np.uint8), np.empty(width, np.float32)
    for row in range(height):
        if is_halved:
            _double(estimate.pixel_class[row // 2], estimate.confidence[row // 2], class_row, confidence_row)
        else:
            class_row, confidence_row = estimate.pixel_class[row], estimate.confidence[row]
        row_m, row_px = measured_m[row], disparity_px[row]
        depth_m, source, confidence = shown.depth_m[row], shown.source[row], shown.confidence[row]
        for col in range(width):
            of_measured, of_others = _sources(class_row[col], confidence_row[col], min_fill_confidence)
            likely = of_measured if row_m[col] >= least_m else of_others
            source[col] = likely if row_px[col] >= MIN_DISPARITY_PX else uint8(Source.INVALID)
        for col in range(width):
            here_m = depth_of(row_px[col], focal_baseline_px_m)
            depth_m[col] = here_m if source[col] != Source.INVALID else float32(0)
        for col in range(width):
            confidence[col] = confidence_row[col] if source[col] != Source.INVALID else float32(0)


@compiled(void(PIXEL_INDICES, ESTIMATE_TYPE, float32, float32, SHOWN_TYPE))
def show_pixels(
    pixels: PixelIndices,
    estimate: DisparityEstimate,
    focal_baseline_px_m: float,
    min_fill_confidence: float,
    # input and output
    shown: OutputImages,
) -> None:
    """Show the estimates of single pixels, none of which is measured, instead of what is shown.

    Args:
        pixels: Row and column in the frame, shape (N, 2).
        estimate: What is known of these pixels, images of shape (1, N).
        focal_baseline_px_m: Depth [m] times disparity [px of the matched images].
        min_fill_confidence: Least confidence of an inpainted pixel that is shown; others become invalid.
        shown: Images of shape (H, W); changed in place.
    """
    for k in range(len(pixels)):
        depth_m, confidence = depth_of(estimate.disparity_px[0, k], focal_baseline_px_m), estimate.confidence[0, k]
        _, source = _sources(estimate.pixel_class[0, k], confidence, min_fill_confidence)
        is_shown, (row, col) = (depth_m > 0) & (source != Source.INVALID), pixels[k]
        shown.depth_m[row, col] = depth_m if is_shown else float32(0)
        shown.source[row, col] = source if is_shown else uint8(Source.INVALID)
        shown.confidence[row, col] = confidence if is_shown else float32(0)
