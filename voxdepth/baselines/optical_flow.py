"""Dense optical flow by interchangeable methods (paper, RQ4), and a temporal filter that follows it.

The filter moves the previous corrected depth by the flow, like the temporal filters that the paper cites (Matyunin et
al. 2011, Avetisyan et al. 2016). It follows moving objects, but not the change of their depth.
"""

from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from ..types import FloatImage, Frame, GrayImage, Intrinsics
from .single_frame import Baseline

FlowImage = npt.NDArray[np.float32]
AgeImage = npt.NDArray[np.int16]

DIS_SMALLEST_PX = 96
"""Smaller images get a border: OpenCV refuses those below 12 pixels, and crashes on some that are long and narrow."""
LEVELS = 3
"""Images of the pyramids, each half as large; one more doubles the motion that can be followed."""
FARNEBACK_WINDOW_PX, FARNEBACK_ITERATIONS = 15, 3
"""A larger window is steadier and blurs the flow at edges."""
HORN_SCHUNCK_ITERATIONS = 30
"""Of each level; more propagate the flow farther into textureless areas."""
ALPHA_GRAY = np.float32(8)
"""Weight of smoothness against brightness [gray values per pixel]; more is smoother."""
NEIGHBOURS = np.array([[1, 2, 1], [2, 0, 2], [1, 2, 1]], np.float32) / 12
"""Weights of the local mean in Horn and Schunck's iteration."""
MAX_CIRCLE_PX = 1.0
"""Flow there and back may miss its start by this; farther off, one of the two is wrong or the point is hidden."""
ALPHA = np.float32(0.4)
"""Weight of the measured depth where it and the warped one agree; less of it is steadier and lags more."""
AGREEMENT = np.float32(0.05)
"""Largest difference of the two, as a share of the measured depth."""
MAX_AGE_FRAMES = 30
"""A hole is filled for this many frames after its point was last measured."""
LAST_PX = 32767
"""Columns and rows are given to OpenCV in 16 bits."""


class Flow(Protocol):
    """A method of dense optical flow."""

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """Where each pixel of the start is in the end, relative to itself: columns and rows [px].

        The result is finite, of shape (H, W, 2) and float32. The images of shape (H, W) are not changed.
        """


class Dis:
    """Inverse search of patches, then variational refinement: Kroeger et al. 2016, DOI 10.1007/978-3-319-46493-0_29.

    The result depends a little on OpenCV's number of threads.
    """

    def __init__(self, *, preset: int = cv2.DISOPTICAL_FLOW_PRESET_FAST) -> None:
        self._dis = cv2.DISOpticalFlow.create(preset)

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """See `Flow`."""
        height, width = start.shape
        flow_px: Any = self._dis.calc(_padded(start), _padded(end), None)  # type: ignore[call-overload]
        return np.ascontiguousarray(flow_px[:height, :width])


class Farneback:
    """Polynomial expansion: Farneback 2003, DOI 10.1007/3-540-45103-X_50.

    It works in a pyramid.
    """

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """See `Flow`."""
        flow_px: Any = cv2.calcOpticalFlowFarneback(
            start, end, None, 0.5, LEVELS, FARNEBACK_WINDOW_PX, FARNEBACK_ITERATIONS, 5, 1.2, 0
        )  # type: ignore[call-overload]
        return np.asarray(flow_px, np.float32)


class HornSchunck:
    """Brightness constancy with a smooth flow: Horn and Schunck 1981, DOI 10.1016/0004-3702(81)90024-2.

    The classical iteration, from coarse to fine in a pyramid because it sees one or two pixels far; at each level the
    end is warped by the flow so far and the remainder is estimated.
    """

    def between(self, start: GrayImage, end: GrayImage) -> FlowImage:
        """See `Flow`."""
        level: list[Any] = [cv2.GaussianBlur(gray.astype(np.float32), (5, 5), 0.8) for gray in (start, end)]
        pyramid = [level]
        while len(pyramid) < LEVELS and min(level[0].shape) >= 2:
            level = [cv2.pyrDown(image) for image in level]
            pyramid.append(level)
        flow_px = np.zeros((*pyramid[-1][0].shape, 2), np.float32)
        for start_level, end_level in reversed(pyramid):
            flow_px = self._refined(_enlarged(flow_px, start_level.shape), start_level, end_level)
        return flow_px

    def _refined(self, flow_px: FlowImage, start: FloatImage, end: FloatImage) -> FlowImage:
        """A better flow [px], shape (h, w, 2), of one level."""
        arrived = _warped(end, flow_px)
        slopes = [cv2.Sobel(0.5 * (start + arrived), cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))]
        flows: list[Any] = [np.ascontiguousarray(flow_px[..., axis]) for axis in (0, 1)]
        rest = arrived - start  # the brightness that no flow at all would leave
        for slope, flow in zip(slopes, flows, strict=True):
            rest -= slope * flow
        stiffness = ALPHA_GRAY**2 + slopes[0] * slopes[0] + slopes[1] * slopes[1]
        pulls = [slope / stiffness for slope in slopes]
        excess, term = np.empty_like(rest), np.empty_like(rest)
        for _ in range(HORN_SCHUNCK_ITERATIONS):
            np.copyto(excess, rest)
            for slope, flow in zip(slopes, flows, strict=True):
                cv2.filter2D(flow, -1, NEIGHBOURS, dst=flow, borderType=cv2.BORDER_REPLICATE)
                np.add(excess, np.multiply(slope, flow, out=term), out=excess)
            for pull, flow in zip(pulls, flows, strict=True):
                np.subtract(flow, np.multiply(pull, excess, out=term), out=flow)
        return np.stack(flows, axis=2)


def _padded(gray: GrayImage) -> GrayImage:
    """Pad to the minimum size of DIS by repeating the last row and column."""
    below, right = (max(DIS_SMALLEST_PX - side, 0) for side in gray.shape)
    return np.pad(gray, ((0, below), (0, right)), mode="edge") if below or right else gray


def _enlarged(flow_px: FlowImage, shape: tuple[int, ...]) -> FlowImage:
    """The flow of a level in the pixels of the next finer one, shape (*shape, 2); of the same one, itself."""
    height, width = shape
    factor = np.array([width / flow_px.shape[1], height / flow_px.shape[0]], np.float32)
    larger: Any = cv2.resize(flow_px, (width, height), interpolation=cv2.INTER_LINEAR)
    return np.asarray(larger * factor, np.float32)


def _warped(end: FloatImage, flow_px: FlowImage) -> FloatImage:
    """The end as seen from the start, shape (h, w): each pixel shows what it flows to."""
    height, width = end.shape
    col = np.arange(width, dtype=np.float32) + flow_px[..., 0]
    row = np.arange(height, dtype=np.float32)[:, None] + flow_px[..., 1]
    return cv2.remap(end, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[return-value]


class FlowFilter(Baseline):
    """Blends measured depth with the warped one where they agree, and fills holes from the latter.

    Args:
        intrinsics: Intrinsics of the camera.
        flow: Method of optical flow; None for `Dis()`.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics, *, flow: Flow | None = None) -> None:
        self._intrinsics = intrinsics
        self._flow = flow or Dis()
        self.reset()

    def reset(self) -> None:
        """Forget the last frame."""
        # Gray image and depth of the last corrected frame, and the frames since its pixels were measured.
        self._last: tuple[GrayImage, FloatImage, AgeImage] | None = None

    def _corrected(self, frame: Frame) -> FloatImage:
        moved_m, age = self._moved(frame.gray)
        depth_m = self._blended(frame.depth_m, moved_m)
        age[frame.depth_m > 0] = 0
        self._last = frame.gray.copy(), depth_m.copy(), age
        return depth_m

    def _moved(self, gray: GrayImage) -> tuple[FloatImage, AgeImage]:
        """The last corrected depth [m] where its points are now, 0 = unknown, and its age [frames]; both (H, W)."""
        if self._last is None:
            return np.zeros(gray.shape, np.float32), np.zeros(gray.shape, np.int16)
        last_gray, last_depth_m, last_age = self._last
        to_last_px = self._flow.between(gray, last_gray)
        landing = landing_of(to_last_px)
        circle_px = to_last_px + taken(self._flow.between(last_gray, gray), landing)
        closed = cv2.magnitude(circle_px[..., 0], circle_px[..., 1]) <= MAX_CIRCLE_PX
        age = taken(last_age, landing) + np.int16(1)
        trusted = closed & (age <= MAX_AGE_FRAMES)
        return np.where(trusted, taken(last_depth_m, landing), np.float32(0)), age

    def _blended(self, measured_m: FloatImage, moved_m: FloatImage) -> FloatImage:
        """The mean of measured and warped depth [m] where they agree, else the measured, in holes the warped depth."""
        difference_m = moved_m - measured_m
        agree = (moved_m > 0) & (np.abs(difference_m) <= AGREEMENT * measured_m)
        blended_m = np.where(agree, measured_m + (1 - ALPHA) * difference_m, measured_m)
        return np.where(measured_m > 0, blended_m, moved_m)


def landing_of(flow_px: FlowImage) -> npt.NDArray[np.int16]:
    """Column and row of the pixel that each pixel flows to, shape (H, W, 2); outside the image if it leaves it."""
    height, width = flow_px.shape[:2]
    landing = flow_px.copy()
    landing[..., 0] += np.arange(width, dtype=np.float32)
    landing[..., 1] += np.arange(height, dtype=np.float32)[:, None]
    return np.rint(np.clip(landing, -1, np.float32(LAST_PX), out=landing), out=landing).astype(np.int16)


def taken(image: Any, landing: npt.NDArray[np.int16]) -> Any:
    """The pixels of an image at the targets, without interpolation; 0 outside of it."""
    return cv2.remap(image, landing, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # type: ignore[call-overload]
