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

    def __post_init__(self) -> None:
        given = self.units_per_m
        if given is not None and not (isinstance(given, Real) and 1 <= given <= 1e6):
            raise FrameError(
                f"units_per_m must be a number of 1 to 1,000,000, got {given!r}: the depth scale of librealsense, in "
                "metres, is its inverse"
            )

    def metres(self, values: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
        """Depth [m] of stored values, shape (H, W), float32; 0 = invalid.

        No depth are 0, NaN, infinity of either sign (REP 117: too far, too near), and 65535, the largest number of 16
        bits. Negative numbers stay, and a `Frame` refuses them.

        Raises:
            FrameError: The median depth is none that a camera measures, and the unit is merely the usual one.
        """
        units_per_m = self.units_per_m or (1.0 if values.dtype.kind == "f" else MILLIMETRES)
        with np.errstate(over="ignore"):  # What is too large for 32 bits becomes infinite.
            stored = values.astype(np.float32)
        depth_m = stored / np.float32(units_per_m)
        depth_m[~np.isfinite(depth_m) | (stored == SATURATED)] = 0
        if not (self.is_known and self.units_per_m) and not self.least_m <= (median_m(depth_m) or 1.0) <= FAR_M:
            raise FrameError(
                f"expected a median depth of {self.least_m:g} to {FAR_M:g} m, got {median_m(depth_m):g} m with "
                f"units_per_m = {units_per_m:g}; state units_per_m (1000 for millimetres, 1 for metres) in "
                "calibration.toml, as --units-per-m, or as the parameter of the node"
            )
        return depth_m


def median_m(depth_m: npt.NDArray[np.float32]) -> float:
    """The median of the valid depths [m], or nearly; 0 without one."""
    sampled = depth_m.ravel()[:: max(1, depth_m.size // SAMPLES)]
    valid = sampled[sampled > 0]
    return float(np.quantile(valid, 0.5, method="lower")) if valid.size else 0.0
