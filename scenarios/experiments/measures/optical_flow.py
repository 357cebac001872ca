"""Dense optical flow by interchangeable methods, the rivals of registration in RQ4.

They stand here and not in the library: nothing but this comparison uses them.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage, GrayImage

FlowImage = npt.NDArray[np.float32]
Flow = Callable[[GrayImage, GrayImage], FlowImage]
"""Where each pixel of the first image is in the second, relative to itself: columns and rows [px], shape (H, W, 2)."""
DIS_SMALLEST_PX = 96
"""Smaller images get a border: OpenCV refuses those below 12 pixels, and crashes on some that are long and narrow."""
LEVELS = 3
"""Images of the pyramids, each half as large; one more doubles the motion that can be followed."""
HORN_SCHUNCK_ITERATIONS = 30
"""Of each level; more propagate the flow farther into textureless areas."""
ALPHA_GRAY = np.float32(8)
"""Weight of smoothness against brightness [gray values per pixel]; more is smoother."""
NEIGHBOURS = np.array([[1, 2, 1], [2, 0, 2], [1, 2, 1]], np.float32) / 12
"""Weights of the local mean in Horn and Schunck's iteration."""


def dis(start: GrayImage, end: GrayImage) -> FlowImage:
    """Return the flow of inverse search, then refinement: Kroeger et al. 2016, DOI 10.1007/978-3-319-46493-0_29."""
    height, width = start.shape
    below, right = (max(DIS_SMALLEST_PX - side, 0) for side in start.shape)
    padded: Any = [np.pad(gray, ((0, below), (0, right)), mode="edge") for gray in (start, end)]
    flow_px: Any = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_FAST).calc(*padded, None)  # type: ignore[call-overload]
    return np.ascontiguousarray(flow_px[:height, :width])


def farneback(start: GrayImage, end: GrayImage) -> FlowImage:
    """Return the flow of polynomial expansion in a pyramid: Farneback 2003, DOI 10.1007/3-540-45103-X_50."""
    options = {"pyr_scale": 0.5, "levels": LEVELS, "winsize": 15, "iterations": 3, "poly_n": 5, "poly_sigma": 1.2}
    flow_px: Any = cv2.calcOpticalFlowFarneback(start, end, None, **options, flags=0)  # type: ignore[call-overload]
    return np.asarray(flow_px, np.float32)


def horn_schunck(start: GrayImage, end: GrayImage) -> FlowImage:
    """Return the smooth flow of constant brightness: Horn and Schunck 1981, DOI 10.1016/0004-3702(81)90024-2.

    The classical iteration, from coarse to fine in a pyramid because it sees one or two pixels far; at each level the
    end is warped by the flow so far and the remainder is estimated.
    """
    level: list[Any] = [cv2.GaussianBlur(gray.astype(np.float32), (5, 5), 0.8) for gray in (start, end)]
    pyramid = [level]
    while len(pyramid) < LEVELS and min(level[0].shape) >= 2:
        level = [cv2.pyrDown(image) for image in level]
        pyramid.append(level)
    flow_px = np.zeros((*pyramid[-1][0].shape, 2), np.float32)
    for start_level, end_level in reversed(pyramid):
        flow_px = _refined(_enlarged(flow_px, start_level.shape), start_level, end_level)
    return flow_px


def _refined(flow_px: FlowImage, start: FloatImage, end: FloatImage) -> FlowImage:
    """Return a better flow [px], shape (h, w, 2), of one level."""
    arrived = followed(end, flow_px, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
    slopes = [cv2.Sobel(0.5 * (start + arrived), cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))]
    flows: list[Any] = [np.ascontiguousarray(flow_px[..., axis]) for axis in (0, 1)]
    rest = arrived - start  # the brightness that no flow at all would leave
    for slope, flow in zip(slopes, flows, strict=True):
        rest -= slope * flow
    stiffness = ALPHA_GRAY**2 + slopes[0] * slopes[0] + slopes[1] * slopes[1]
    for _ in range(HORN_SCHUNCK_ITERATIONS):
        means = [cv2.filter2D(flow, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE) for flow in flows]
        excess = (rest + slopes[0] * means[0] + slopes[1] * means[1]) / stiffness
        flows = [mean - slope * excess for mean, slope in zip(means, slopes, strict=True)]
    return np.stack(flows, axis=2)


def _enlarged(flow_px: FlowImage, shape: tuple[int, ...]) -> FlowImage:
    """Return the flow of a level in the pixels of the next finer one, shape (*shape, 2); of the same one, itself."""
    height, width = shape
    factor = np.array([width / flow_px.shape[1], height / flow_px.shape[0]], np.float32)
    larger: Any = cv2.resize(flow_px, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(larger * factor, np.float32)


def followed(
    image: FloatImage, to_image_px: FlowImage, interpolation: int = cv2.INTER_NEAREST, border: int = cv2.BORDER_CONSTANT
) -> FloatImage:
    """Return each pixel of what its flow leads to in an image, shape (h, w).

    Args:
        image: Image that the flow leads to, shape (h, w).
        to_image_px: Flow from the result to the image, along columns and rows, shape (h, w, 2).
        interpolation: Constant of OpenCV; by default the nearest pixel is taken.
        border: Constant of OpenCV for what lies outside of the image; by default 0.
    """
    height, width = image.shape
    col = np.arange(width, dtype=np.float32) + to_image_px[..., 0]
    row = np.arange(height, dtype=np.float32)[:, None] + to_image_px[..., 1]
    return cv2.remap(image, col, row, interpolation, borderMode=border)  # type: ignore[return-value]


FLOWS: dict[str, Flow] = {"DIS flow": dis, "Farneback": farneback, "Horn-Schunck": horn_schunck}
