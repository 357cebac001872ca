"""The post-processing that Intel recommends for its cameras: disparity, spatial, temporal, depth, hole filling.

What is computed, and how it is rounded, is what librealsense 2.59 does, which the tests compare with bit by bit.
"""

import numpy as np

from ..errors import ConfigError, FrameError
from ..types import CorrectedDepth, FloatImage, Frame, Intrinsics
from .inferred import inferred
from .realsense_holes import HoleFillName, hole_fill
from .realsense_spatial import SpatialFilter
from .realsense_temporal import TemporalConfig, TemporalFilter

STEPS_PER_PX = 32
"""The SDK counts disparity in these."""
LARGEST_UNITS = 2**16 - 1
"""Depth has 16 bits in the SDK."""


class RealSenseChain:
    """librealsense's filters in the order that its documentation recommends, each with the SDK's parameters.

    Depth is rounded to the camera's units, as the SDK has it in 16 bits: depths beyond the largest (65.5 m in
    millimetres) are cut to that, those below half a unit are invalid. Measured pixels change, too.

    Args:
        intrinsics: Of the camera, with the baseline; every frame must have its shape.
        spatial: The spatial filter.
        temporal: Parameters of the temporal filter.
        fill: Mode of the hole filling.
        units_per_m: Steps of the depth in a metre.

    Raises:
        ConfigError: The baseline is not known, there is no such hole filling, or the units are not positive.
    """

    uses_gray = False

    def __init__(
        self,
        intrinsics: Intrinsics,
        *,
        spatial: SpatialFilter | None = None,
        temporal: TemporalConfig | None = None,
        fill: HoleFillName = "farthest",
        units_per_m: float = 1000.0,
    ) -> None:
        if not 0 < units_per_m < np.inf:
            raise ConfigError(f"units_per_m must be positive and finite (1000 for millimetres), got {units_per_m}")
        self._shape = intrinsics.shape
        self._units_per_m = np.float32(units_per_m)
        self._factor = disparity_factor(intrinsics, units_per_m)
        self._spatial = spatial or SpatialFilter()
        self._temporal = TemporalFilter(temporal)
        self._fill = hole_fill(fill)

    def process(self, frame: Frame) -> CorrectedDepth:
        """The smoothed and filled frame; filled pixels, also those that the past filled, have source INPAINTED.

        Raises:
            FrameError: The frame does not have the camera's shape.
        """
        if frame.depth_m.shape != self._shape:
            raise FrameError(f"expected frames of shape {self._shape} like the camera's, got {frame.depth_m.shape}")
        disparity = self._divided(self._rounded(frame.depth_m))
        disparity = self._spatial.smooth(disparity)
        disparity = self._temporal.smooth(disparity)
        units = self._divided(disparity)
        units += np.float32(0.5)
        np.floor(units, out=units)
        units /= self._units_per_m
        return inferred(frame, self._fill(units))

    def reset(self) -> None:
        """Forget the stream."""
        self._temporal.reset()

    def _rounded(self, depth_m: FloatImage) -> FloatImage:
        """Depth [units] that 16 bits can hold."""
        units: FloatImage = np.minimum(depth_m, LARGEST_UNITS / self._units_per_m)
        units *= self._units_per_m
        return np.rint(units, out=units)

    def _divided(self, image: FloatImage) -> FloatImage:
        """Depth [units] of disparity [1/32 px], and the other way round; 0 stays 0."""
        return np.divide(self._factor, image, out=np.zeros_like(image), where=image > 0)


def disparity_factor(intrinsics: Intrinsics, units_per_m: float) -> np.float32:
    """Product of depth [units] and disparity [1/32 px], in the SDK's single precision.

    Raises:
        ConfigError: The baseline is not known.
    """
    if intrinsics.baseline_m is None:
        raise ConfigError(
            "the RealSense filters work on disparity and need the stereo baseline; name it as baseline_m of the "
            "intrinsics (0.095 for a D455, 0.05 for a D435)"
        )
    baseline_m = np.float32(intrinsics.baseline_m * 1000) * np.float32(0.001)  # cameras report it in millimetres
    return baseline_m * np.float32(intrinsics.fx_px) * np.float32(STEPS_PER_PX) / np.float32(1 / units_per_m)
