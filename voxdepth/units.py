"""Which depth in metres a stored value is. Files, messages of ROS and `Frame` ask here, so that all mean the same."""

from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import numpy.typing as npt

from .errors import FrameError

MILLIMETRES = 1000.0
"""Steps of a metre in depth of whole numbers, unless the source says otherwise (REP 118)."""
SATURATED = 65535
"""What sources of 16 bits store for a depth beyond their range, or for none."""
LEAST_M, FAR_M = 0.01, 300.0
"""Range of the median depth of an image [m]; outside of it the values are more likely in another unit."""
NAMED = {1.0: "metres", 100.0: "centimetres", 1000.0: "millimetres", 10_000.0: "steps of 0.1 mm"}
"""What steps of a metre are called."""
HALVES, HALF_SHARE = (0x3800, 0x7C00), 0.99
"""Bits of floats of 16 bits from 0.5 to infinity, and the share of an image that is dense, or of its values among them,
from which on whole numbers may be such floats. As millimetres they are 14.3 to 31.7 m."""
SAMPLES = 10_000
"""Number of pixels of which the valid ones have the median."""


@dataclass(frozen=True)
class Unit:
    """The unit of the depth of one source."""

    units_per_m: float | None = None
    """Steps of a metre, 1 to 1e6; None takes 1000 for whole numbers and 1 for floats, as ROS does (REP 118)."""
    is_known: bool = True
    """Whether the source or the user says so; values may contradict a unit that is merely usual."""
    least_m: float = LEAST_M
    """Least median depth of an image [m] that does not contradict a usual unit."""
    convention: str = ""
    """Who has this unit, in words, where it is merely usual and must be reported; empty where it is certain."""
    may_be_halves: bool = False
    """Whether whole numbers may be the bits of floats of 16 bits, as some renderers put them into images."""

    def __post_init__(self) -> None:
        given = self.units_per_m
        if given is not None and not (isinstance(given, Real) and 1 <= given <= 1e6):
            raise FrameError(
                f"units_per_m must be a number of 1 to 1,000,000, got {given!r}: the depth scale of librealsense, in "
                "metres, is its inverse"
            )

    def steps(self, kind: np.dtype[Any]) -> float:
        """Return the steps of a metre in values of a type."""
        return self.units_per_m or (1.0 if kind.kind == "f" else MILLIMETRES)

    def description(self, values: npt.NDArray[Any]) -> str:
        """Return how an image of stored values, shape (H, W), is read, and what is to be given if that is wrong."""
        steps = self.steps(values.dtype)
        return (
            f"has depth in {NAMED.get(steps, f'steps of 1/{steps:g} m')}, as {self.convention}, "
            f"{median_m(self.metres(values)):.3g} m in the median of its first image; if that is wrong, state "
            "--units-per-m (256 for KITTI, 100 for Virtual KITTI, 5000 for TUM RGB-D and ICL-NUIM)"
        )

    def metres(self, values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Return the depth [m] of stored values, shape (H, W), float32; 0 = invalid.

        No depth are 0, NaN, infinity of either sign (REP 117: too far, too near), and 65535, the largest number of 16
        bits, unless an image of wider whole numbers has larger ones. Negative numbers stay, and a `Frame` refuses them.

        Raises:
            FrameError: The median depth is none that a camera measures, or the values may be the bits of floats, and
                the unit is merely the usual one.
        """
        if self.may_be_halves and _are_like_halves(values):
            floats = np.array([values[values > 0].min(), values.max()]).astype(np.uint16).view(np.float16)
            raise FrameError(
                f"values of {values[values > 0].min()} to {values.max()} may be millimetres as well as the bits of "
                f"floats of 16 bits of {floats[0]:.3g} to {floats[1]:.3g} m, as Mid-Air has them: state units_per_m = "
                "1000 for millimetres, or write the floats as .npy (image.view(numpy.float16))"
            )
        units_per_m = self.steps(values.dtype)
        with np.errstate(over="ignore"):  # What is too large for 32 bits becomes infinite.
            stored = values.astype(np.float32)
        depth_m = stored / np.float32(units_per_m)
        depth_m[~np.isfinite(depth_m)] = 0
        if values.dtype.kind == "f" or values.dtype.itemsize == 2 or not np.any(values > SATURATED):
            depth_m[stored == SATURATED] = 0
        if not (self.is_known and self.units_per_m) and not self.least_m <= (median_m(depth_m) or 1.0) <= FAR_M:
            raise FrameError(
                f"expected a median depth of {self.least_m:g} to {FAR_M:g} m, got {median_m(depth_m):g} m with "
                f"units_per_m = {units_per_m:g}; state units_per_m (1000 for millimetres, 1 for metres) in "
                "calibration.toml, as --units-per-m, or as the parameter of the node"
            )
        return depth_m


def to_millimetres(depth_m: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
    """Convert depth to millimetres, shape (H, W): 0 where invalid, 65535 for everything beyond 65.535 m."""
    return np.where(depth_m > 0, np.rint(np.clip(depth_m, 0.001, 65.535) * 1000), 0).astype(np.uint16)


def _are_like_halves(values: npt.NDArray[Any]) -> bool:
    """Return whether nearly all pixels of an image are positive floats of 16 bits, of which most begin alike."""
    if values.dtype.kind == "f" or values.dtype.itemsize != 2:
        return False
    return float(np.mean((values >= HALVES[0]) & (values <= HALVES[1]))) >= HALF_SHARE


def median_m(depth_m: npt.NDArray[np.float32]) -> float:
    """Return the median of the valid depths [m], or nearly; 0 without one."""
    sampled = depth_m.ravel()[:: max(1, depth_m.size // SAMPLES)]
    valid = sampled[sampled > 0]
    return float(np.quantile(valid, 0.5, method="lower")) if valid.size else 0.0
