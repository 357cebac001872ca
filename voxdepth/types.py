"""Plain data that every package exchanges: cameras, frames and corrected depth.

Conventions: `T_a_b` maps coordinates in b to coordinates in a; the camera frame is x right, y down,
z forward; pixel centres lie at integer coordinates; depth is along the optical axis, 0 = invalid.
"""

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from numbers import Integral, Real
from typing import Any, Protocol, Self, TypeVar

import numpy as np
import numpy.typing as npt

from .errors import FrameError
from .units import FAR_M, Unit, median_m

FloatArray = npt.NDArray[np.float64]
FloatImage = npt.NDArray[np.float32]
GrayImage = npt.NDArray[np.uint8]
MaskImage = npt.NDArray[np.bool_]
Position = TypeVar("Position", float, FloatArray, FloatImage)


CORRECT_SHARE = 0.05
"""A depth is right if the error of its disparity is at most this share of it ..."""
CORRECT_PX = 0.25
"""... or at most this [px], about the accuracy of stereo matching."""
CONFIDENCE_OF_FILLS = 0.5
"""Confidence that `CorrectedDepth.of` gives a depth that the sensor did not measure: between a measured one (1) and
none (0). It only tells the sources apart, and who trusts depth from 0.5 on trusts every fill. Those of
`create_corrector` are probabilities, see `voxdepth.calibration`."""
ASSUMED_BASELINE_M = 0.05
"""Baseline of a camera that is not a stereo pair [m], about that of consumer depth cameras."""
WIDEST_DEG, WIDE_DEG, ANGLES_DEG = 170.0, 140.0, (45.0, 130.0)
"""Largest horizontal field of view of a rectified image, and the largest one if the focal length in pixels could be an
angle, as data sheets state one: in this range, and with one decimal at most."""
LARGEST_STAMP_S = 1e11
"""Largest time of a frame [s]; those of today are less in seconds, and more in other units."""
LARGEST_SIDE_PX = 2**16
"""Largest width or height of an image."""
LARGEST_LENS = 1000
"""Largest ratio of a focal length to the longer side of its image. The shortest is a pixel divided by that."""
SHORTEST_BASELINE_M = 1e-3
"""Least baseline of a stereo pair."""
LARGEST_BASELINE_M = 10.0
"""Largest baseline of a stereo pair. One in millimetres lies beyond it."""
SAME_LENS = 1e-3
"""Largest difference of the lenses of one camera, in longer sides of the image, and of its baselines, in baselines.

Drivers calibrate again while they run, and store numbers of 32 bits. At the border of an image of 640 pixels it is less
than a pixel."""
NEGLIGIBLE_DISTORTION = 1e-3
"""A coefficient of distortion below it moves no pixel by as much as one."""
RIGID_TOLERANCE = 1e-3
"""Largest error of the rotation of a pose, which 32 bits leave."""
LAST_ROW_TOLERANCE = 1e-6
"""Largest error of the last row of a pose."""
LARGEST_POSITION_M = 1e9
"""Largest coordinate of a camera [m], beyond which 32 bits overflow."""
LARGEST_DISPARITY_SCALE = 1000.0
"""Largest ratio of the widths of matched and given images. The smallest is its inverse."""


def resized(position_px: Position, factor: float) -> Position:
    """Return columns or rows after `cv2.resize` by a factor; the centre of the first pixel is 0.

    It keeps the image borders, which lie half a pixel outside the pixel centres.
    """
    return (position_px + 0.5) * factor - 0.5


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """Pinhole camera without distortion: `u = fx x/z + cx`, `v = fy y/z + cy`."""

    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    width_px: int
    height_px: int
    baseline_m: float | None = None
    """Distance to the right camera [m]; None for a camera that is not a stereo pair."""
    disparity_scale: float = 1.0
    """Width of the images that were matched, divided by that of these: 3 for depth that a filter decimated by 3, whose
    error is a third of what it would be for depth that was matched at this size."""

    def __post_init__(self) -> None:
        _require_numbers(Integral, width_px=self.width_px, height_px=self.height_px)
        _require_numbers(Real, fx_px=self.fx_px, fy_px=self.fy_px, cx_px=self.cx_px, cy_px=self.cy_px)
        _require_numbers(Real, baseline_m=self.baseline_m or 0, disparity_scale=self.disparity_scale)
        size = f"{self.width_px}x{self.height_px}"
        if min(self.width_px, self.height_px) < 1 or max(self.width_px, self.height_px) > LARGEST_SIDE_PX:
            raise FrameError(f"an image has 1 to {LARGEST_SIDE_PX} pixels a side, got {size}")
        self._require_lens(size)
        if self.baseline_m is not None and not SHORTEST_BASELINE_M <= self.baseline_m <= LARGEST_BASELINE_M:
            raise FrameError(
                f"the stereo baseline must be {SHORTEST_BASELINE_M:g} to {LARGEST_BASELINE_M:g} m, got "
                f"{self.baseline_m} m: is it in metres?"
            )
        if not 1 / LARGEST_DISPARITY_SCALE <= self.disparity_scale <= LARGEST_DISPARITY_SCALE:
            raise FrameError(
                f"disparity_scale must be {1 / LARGEST_DISPARITY_SCALE:g} to {LARGEST_DISPARITY_SCALE:g}, got "
                f"{self.disparity_scale}"
            )
        _store_python_numbers(self)

    def _require_lens(self, size: str) -> None:
        """Require focal lengths and a principal point that a camera of an image of that size may have."""
        if self.fx_px > 0 > self.fy_px:
            raise FrameError(
                f"fy_px must be positive, got {self.fy_px}: rows are counted downwards here; where the y axis points "
                f"up, as in ICL-NUIM, it is {-self.fy_px}"
            )
        longest_px = LARGEST_LENS * max(self.width_px, self.height_px)
        if not longest_px >= max(self.fx_px, self.fy_px) >= min(self.fx_px, self.fy_px) >= 1 / LARGEST_LENS:
            raise FrameError(
                f"focal lengths must be {1 / LARGEST_LENS} to {longest_px} px for an image of {size} pixels, "
                f"got {self.fx_px} and {self.fy_px}: are they in pixels?"
            )
        hfov_deg = math.degrees(2 * math.atan(self.width_px / 2 / self.fx_px))
        is_like_an_angle = ANGLES_DEG[0] <= self.fx_px <= ANGLES_DEG[1] and round(self.fx_px, 1) == self.fx_px
        if hfov_deg > (WIDE_DEG if is_like_an_angle else WIDEST_DEG):
            raise FrameError(
                f"fx_px = {self.fx_px:g} of an image of {size} pixels is a field of view of {hfov_deg:.0f} degrees: is "
                "it an angle, or of another image size? It is a focal length in pixels; Intrinsics.from_hfov takes "
                "an angle in degrees"
            )
        far_x_px, far_y_px = abs(self.cx_px - self.width_px / 2), abs(self.cy_px - self.height_px / 2)
        if not (far_x_px <= self.width_px and far_y_px <= self.height_px):
            raise FrameError(
                f"the principal point ({self.cx_px}, {self.cy_px}) is far outside of an image of {size} pixels: is the "
                "calibration that of another image size?"
            )

    @property
    def focal_baseline_px_m(self) -> float:
        """Depth [m] times disparity [px of the matched images].

        A camera that is no stereo pair is assumed to have `ASSUMED_BASELINE_M`.
        """
        return self.disparity_scale * self.fx_px * (self.baseline_m or ASSUMED_BASELINE_M)

    @classmethod
    def from_hfov(
        cls, *, width_px: int, height_px: int, hfov_deg: float, baseline_m: float | None = None
    ) -> "Intrinsics":
        """Return a centred camera with square pixels and a horizontal field of view.

        Args:
            width_px: Width of the images.
            height_px: Their height.
            hfov_deg: Horizontal field of view [deg], up to 170, between the outer edges of the outermost pixels.
            baseline_m: Distance of the stereo cameras; None without a second one.
        """
        _require_numbers(Integral, width_px=width_px, height_px=height_px)
        _require_numbers(Real, hfov_deg=hfov_deg)
        if not 0 < hfov_deg <= WIDEST_DEG:
            raise FrameError(f"the horizontal field of view must lie in (0, {WIDEST_DEG:g}] degrees, got {hfov_deg}")
        if hfov_deg < math.pi:
            raise FrameError(
                f"a horizontal field of view of {hfov_deg} degrees is that of no depth camera: is it in radians? "
                "math.degrees converts them"
            )
        f = width_px / 2 / math.tan(math.radians(hfov_deg) / 2)
        cx, cy = (width_px - 1) / 2, (height_px - 1) / 2
        return cls(fx_px=f, fy_px=f, cx_px=cx, cy_px=cy, width_px=width_px, height_px=height_px, baseline_m=baseline_m)

    @classmethod
    def from_camera_info(cls, info: Any, *, baseline_m: float | None = None) -> "Intrinsics":
        """Read the camera of a ROS `sensor_msgs/CameraInfo` from its fields; ROS is not imported.

        The projection matrix `P` (ROS 1) or `p` (ROS 2), 12 numbers in rows of four, describes rectified images. Its
        fourth column gives the baseline unless it is an argument: for the right camera of a pair it is (-fx B, 0, 0).
        Some drivers write other translations there, which do not count.
        Where it is all zeros, as librealsense writes it, the camera matrix `K` or `k` of undistorted images counts.

        Raises:
            FrameError: The message lacks a field, its images are binned or cut, or the camera is not calibrated.
        """
        projection = getattr(info, "p", getattr(info, "P", None))
        if projection is None or len(projection) != 12 or not hasattr(info, "width") or not hasattr(info, "height"):
            raise FrameError(f"expected a CameraInfo with width, height and 12 numbers p, got {type(info).__name__}")
        fx, _, cx, tx, _, fy, cy = (float(x) for x in projection[:7])
        if not any(projection):
            fx, _, cx, _, fy, cy = (float(x) for x in getattr(info, "k", getattr(info, "K", [0] * 9))[:6])
            if is_distorted(info):
                raise FrameError("the CameraInfo has a distortion, but no projection matrix: rectify the images")
        if fx <= 0 or fy <= 0:
            raise FrameError(f"the CameraInfo has focal lengths {fx}, {fy}: is the camera calibrated?")
        roi = getattr(info, "roi", None)  # zeros mean the whole image
        is_cut = (getattr(roi, "width", 0), getattr(roi, "height", 0)) not in ((0, 0), (info.width, info.height))
        if max(getattr(info, "binning_x", 0), getattr(info, "binning_y", 0)) > 1 or is_cut:
            raise FrameError("the CameraInfo is of binned or cut images: pass the Intrinsics of the images themselves")
        others = max(abs(float(projection[7])), abs(float(projection[11])))
        if baseline_m is None and tx < 0 and others <= SAME_LENS * -tx:
            baseline_m = -tx / fx
        size = {"width_px": int(info.width), "height_px": int(info.height)}
        return cls(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, baseline_m=baseline_m, **size)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (H, W)."""
        return self.height_px, self.width_px

    def is_same_camera(self, other: "Intrinsics") -> bool:
        """Return whether two cameras differ by no more than the calibrations of one camera do, see `SAME_LENS`."""
        if self.shape != other.shape or (self.baseline_m is None) != (other.baseline_m is None):
            return False
        one, another = ((each.fx_px, each.fy_px, each.cx_px, each.cy_px) for each in (self, other))
        return (
            bool(np.allclose(one, another, rtol=0, atol=SAME_LENS * max(self.shape)))
            and math.isclose(self.baseline_m or 0, other.baseline_m or 0, rel_tol=SAME_LENS)
            and math.isclose(self.disparity_scale, other.disparity_scale, rel_tol=SAME_LENS)
        )

    def scaled(self, width_px: int, height_px: int) -> "Intrinsics":
        """Return the camera of the images that `cv2.resize` makes of those of this one, after they were matched."""
        a, b = width_px / self.width_px, height_px / self.height_px
        fx, fy, cx, cy = self.fx_px * a, self.fy_px * b, resized(self.cx_px, a), resized(self.cy_px, b)
        matched = self.disparity_scale * self.width_px / width_px
        lens = {"fx_px": fx, "fy_px": fy, "cx_px": cx, "cy_px": cy, "disparity_scale": matched}
        return replace(self, width_px=width_px, height_px=height_px, **lens)

    def reduced(self, max_width_px: int) -> "Intrinsics":
        """Return the camera of images of at most that width and of the same aspect ratio."""
        width_px = min(self.width_px, max_width_px)
        return self.scaled(width_px, max(round(self.height_px * width_px / self.width_px), 1))


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One measurement: gray image, depth, and perhaps a pose estimate.

    Depth of which half lies beyond 300 m gets a warning: it may be in millimetres.
    The arrays are copied only if they are not in C order. `DepthCorrector.process` does not use them after it returns,
    and a pipeline not after it delivers the frame.
    """

    stamp_s: float
    """Time of capture [s]; strictly increasing within a stream."""
    gray: GrayImage
    """Image of the pixels of the depth, shape (H, W), uint8: the left one of a stereo pair, or that which the depth is
    aligned to."""
    depth_m: FloatImage
    """Depth along the optical axis [m], shape (H, W), float32, finite; 0 = invalid."""
    T_world_cam: FloatArray | None = None
    """Pose estimate of the caller, shape (4, 4); None without one."""

    @classmethod
    def from_millimetres(
        cls,
        *,
        stamp_s: float,
        gray: GrayImage,
        depth_mm: npt.NDArray[np.uint16],
        T_world_cam: FloatArray | None = None,
    ) -> "Frame":
        """Create a frame from 16-bit depth in millimetres; 0 and 65535, a saturated depth, are invalid.

        Args:
            stamp_s: Time of capture; strictly increasing within a stream.
            gray: Gray image, shape (H, W), uint8.
            depth_mm: Depth along the optical axis, shape (H, W), uint16.
            T_world_cam: Pose estimate of the caller, shape (4, 4); None without one.

        Raises:
            FrameError: The depth is not uint16, or the images have different shapes.
        """
        return cls.from_units(stamp_s=stamp_s, gray=gray, depth=depth_mm, units_per_m=1000.0, T_world_cam=T_world_cam)

    @classmethod
    def from_units(
        cls,
        *,
        stamp_s: float,
        gray: GrayImage,
        depth: npt.NDArray[np.uint16],
        units_per_m: float,
        T_world_cam: FloatArray | None = None,
    ) -> "Frame":
        """Create a frame from 16-bit depth in any unit; 0 and 65535, a saturated depth, are invalid.

        Args:
            stamp_s: Time of capture; strictly increasing within a stream.
            gray: Gray image, shape (H, W), uint8.
            depth: Depth along the optical axis in units of the camera, shape (H, W), uint16.
            units_per_m: Units in a metre: 1000 in most cameras, 5000 in TUM RGB-D.
            T_world_cam: Pose estimate of the caller, shape (4, 4); None without one.

        Raises:
            FrameError: The depth is not uint16, the images have different shapes, or `units_per_m` is not 1 to 1e6.
        """
        if _kind(depth) != "uint16":
            raise FrameError(f"expected depth as a uint16 array, got {_kind(depth)}; Frame.from_metres takes metres")
        depth_m = Unit(units_per_m).metres(depth)
        return cls(stamp_s=stamp_s, gray=gray, depth_m=depth_m, T_world_cam=T_world_cam)

    @classmethod
    def from_metres(
        cls, *, stamp_s: float, gray: GrayImage, depth_m: npt.NDArray[Any], T_world_cam: FloatArray | None = None
    ) -> "Frame":
        """Create a frame from depth in metres as in ROS (REP 117, REP 118): NaN, +inf and -inf are holes.

        Args:
            stamp_s: Time of capture; strictly increasing within a stream.
            gray: Gray image, shape (H, W), uint8.
            depth_m: Depth along the optical axis, shape (H, W), of floating point; 0 is invalid, too.
            T_world_cam: Pose estimate of the caller, shape (4, 4); None without one.

        Raises:
            FrameError: The depth is not of floating point, a finite one is negative, or the shapes differ.
        """
        if _kind(depth_m) not in ("float16", "float32", "float64"):
            raise FrameError(f"expected metres as an array of floats, got {_kind(depth_m)}; see Frame.from_millimetres")
        return cls(stamp_s=stamp_s, gray=gray, depth_m=Unit(1.0).metres(depth_m), T_world_cam=T_world_cam)

    def __post_init__(self) -> None:
        _store_python_numbers(self)
        _require_numbers(Real, stamp_s=self.stamp_s)
        if not abs(self.stamp_s) <= LARGEST_STAMP_S:
            raise FrameError(
                f"stamp_s must be a finite number of seconds, at most {LARGEST_STAMP_S:g}, got {self.stamp_s}: is it "
                "in nanoseconds, microseconds or milliseconds? Divide it"
            )
        self._require_images()
        T = self.T_world_cam
        if T is not None and not _is_rigid(T):
            raise FrameError(f"T_world_cam must be an array, a finite rigid pose of shape (4, 4), got {T!r}")
        for name in ("gray", "depth_m"):  # Compiled loops and OpenCV take rows one after the other.
            object.__setattr__(self, name, np.ascontiguousarray(getattr(self, name)))

    def _require_images(self) -> None:
        if not (_is_plain(self.gray) and _is_plain(self.depth_m)):
            raise FrameError(
                f"gray and depth_m must be arrays, got {_kind(self.gray)} and {_kind(self.depth_m)}; a masked array "
                "becomes one by filled(0)"
            )
        if self.gray.ndim != 2 or self.gray.dtype != np.uint8:
            raise FrameError(f"gray must be uint8 of shape (H, W), got {self.gray.dtype} of shape {self.gray.shape}")
        if self.depth_m.shape != self.gray.shape or self.depth_m.dtype != np.float32:
            raise FrameError(
                f"depth_m must be float32 of shape {self.gray.shape} like gray, got {self.depth_m.dtype} of shape "
                f"{self.depth_m.shape}; see Frame.from_millimetres and Frame.from_metres"
            )
        if self.depth_m.size == 0:
            raise FrameError("the images of a frame are empty")
        low, high = float(self.depth_m.min()), float(self.depth_m.max())
        if not (low >= 0 and high < np.inf):
            raise FrameError(
                f"depth_m must be finite and not negative (0 = invalid), got values from {low} to {high} m; "
                "replace what is not by 0, as Frame.from_metres does with NaN and infinity"
            )
        if high > FAR_M and (middle_m := median_m(self.depth_m)) > FAR_M:
            warnings.warn(
                f"the median of depth_m is {middle_m:g} m: are they millimetres? Divide them by 1000, or use "
                "Frame.from_millimetres",
                stacklevel=4,
            )

    def require_shape(self, shape: tuple[int, int]) -> None:
        """Raise a `FrameError` if the images have another shape (rows, columns)."""
        if self.depth_m.shape != shape:
            raise FrameError(f"frames of this camera have shape {shape}, got {self.depth_m.shape}")


def is_distorted(info: Any) -> bool:
    """Return whether a ROS `CameraInfo` is of images that are distorted before they are rectified."""
    return any(abs(x) > NEGLIGIBLE_DISTORTION for x in getattr(info, "d", getattr(info, "D", ())))


def _require_numbers(kind: type[Real] | type[Integral], /, **given: object) -> None:
    """Raise a `FrameError` for a value that is no number of a kind."""
    for name, value in given.items():
        if not isinstance(value, kind) or isinstance(value, bool):
            expected = "a whole number" if kind is Integral else "a number"
            raise FrameError(f"{name} must be {expected}, got {value!r} of type {type(value).__name__}")


def _store_python_numbers(owner: object) -> None:
    """Replace NumPy's numbers in the fields of a frozen dataclass: a float32 would make all that follows one."""
    for name, value in vars(owner).items():
        if isinstance(value, np.generic):
            object.__setattr__(owner, name, value.item())


def _is_plain(given: object) -> bool:
    return isinstance(given, np.ndarray) and not np.ma.isMaskedArray(given)


def _kind(given: object) -> str:
    if np.ma.isMaskedArray(given):
        return "masked array"
    return given.dtype.name if isinstance(given, np.ndarray) else type(given).__name__


def _is_rigid(T: object) -> bool:
    if not isinstance(T, np.ndarray) or not _is_plain(T) or T.shape != (4, 4) or T.dtype.kind not in "fiu":
        return False
    rotation, position_m = T[:3, :3], T[:3, 3]
    if not np.isfinite(T).all() or np.abs(T[3] - (0, 0, 0, 1)).max() > LAST_ROW_TOLERANCE:
        return False
    if np.abs(rotation).max() > 2 or np.abs(position_m).max() > LARGEST_POSITION_M:
        return False
    return bool(np.allclose(rotation @ rotation.T, np.eye(3), atol=RIGID_TOLERANCE) and np.linalg.det(rotation) > 0)


class Source(IntEnum):
    """Origin of the depth of a pixel."""

    INVALID = 0
    """There is no depth."""
    SENSOR = 1
    """It was measured; it may be averaged with earlier frames."""
    MEMORY = 2
    """It comes from earlier frames: there is no measurement, or the method rejected it."""
    INPAINTED = 3
    """It is an estimate from neighbouring pixels, of this image and, with the default method, of the memory."""


class Diagnostics(Protocol):
    """What a method reports about its work on one frame, beyond the result that all methods share."""

    def facts(self) -> Mapping[str, str | int | float]:
        """Return scalars for logs and reports, by name; what is a `StrEnum` or a `bool` is counted.

        A `StrEnum` is a state, or the kind of an event if `none` is one of its values. A `bool` is an event, too. Any
        fact that is `passthrough` says that the method handed the depth on as it came.
        """


@dataclass(frozen=True, kw_only=True, eq=False)
class CorrectedDepth:
    """Result of a corrector for one frame."""

    depth_m: FloatImage
    """Depth along the optical axis [m], shape (H, W), float32; 0 = invalid."""
    source: GrayImage
    """One `Source` per pixel, shape (H, W), uint8."""
    confidence: FloatImage
    """Confidence per pixel in 0..1, shape (H, W), float32; 0 where invalid. That of the default method, and of every
    corrector that `create_corrector` makes, is the probability that the depth is right, see `CORRECT_SHARE`."""
    timings_s: Mapping[str, float] = field(default_factory=dict)
    """Wall-clock time of each step [s], for benchmarks; never part of a result."""
    diagnostics: Diagnostics | None = None
    """What the method reports about its work on this frame; None for methods that report nothing."""

    @classmethod
    def of(cls, frame: Frame, depth_m: FloatImage) -> Self:
        """Return the result of a method whose source and confidence follow from the depth alone.

        Source SENSOR and confidence 1 where frame and result have a depth, INPAINTED and `CONFIDENCE_OF_FILLS` where
        only the result has one, INVALID and 0 elsewhere, also where the frame lost its depth.

        A method that knows how probably its depths are right gives that instead, by `dataclasses.replace`.
        """
        seen, valid = frame.depth_m > 0, depth_m > 0
        source = np.where(seen, np.uint8(Source.SENSOR), np.uint8(Source.INPAINTED))
        confidence = np.where(seen, np.float32(1), np.float32(CONFIDENCE_OF_FILLS))
        source *= valid
        confidence *= valid
        return cls(depth_m=depth_m, source=source, confidence=confidence)


class DepthCorrector(Protocol):
    """A method that corrects a stream of depth frames, one at a time and in order.

    A class that names this protocol as its base needs no more than `process`.
    """

    uses_gray: bool = True
    """Whether the corrector needs gray images; a simulator can leave them out otherwise."""

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame. The input is neither modified nor kept, and the result has arrays of its own."""

    def reset(self) -> None:
        """Forget the stream; the next frame starts a new one. A method that keeps nothing has nothing to forget."""
        return


def close(corrector: DepthCorrector) -> None:
    """Close a corrector that can be closed, as one with threads or a device can."""
    method = getattr(corrector, "close", None)
    if method is not None:
        method()
