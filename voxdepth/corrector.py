"""The two correctors of this library that use earlier frames: the default method and the method of the paper."""

from typing import Any, TypeVar

import numpy as np

from .errors import ConfigError, FrameError
from .model import Model
from .paper.config import PaperConfig
from .paper.method import PaperMethod
from .temporal.config import VoxDepthConfig
from .temporal.method import TemporalMethod
from .types import CorrectedDepth, Frame, Intrinsics

Config = TypeVar("Config", bound=Model)


class StreamCorrector:
    """Corrects the depth of a stream of frames, which must come in order and from one camera.

    `process` does all work on a frame. `CorrectionPipeline` runs the two halves, `align` and `combine`, in parallel for
    successive frames.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics, method: PaperMethod | TemporalMethod) -> None:
        self._intrinsics = intrinsics
        self._method = method
        self._last_stamp_s = -np.inf
        self._closed = False

    def reset(self) -> None:
        """Forget all frames and their time stamps."""
        self._method.reset()
        self._last_stamp_s = -np.inf

    def close(self) -> None:
        """Wait for work in other threads, and accept no more frames.

        A call is needed only to end the threads at a certain time: otherwise they end with the corrector.
        """
        self._closed = True
        self._method.close()

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame.

        Raises:
            FrameError: The frame has another size than the camera, or is not later than the one before; or the
                corrector is closed.
        """
        return self.combine(self.align(frame))

    def align(self, frame: Frame) -> Any:
        """Do the first half of the work, which holds all state. Only `combine` may use the result.

        Raises:
            FrameError: As in `process`.
        """
        self._check(frame)
        return self._method.align(frame)

    def combine(self, aligned: Any) -> CorrectedDepth:
        """Do the second half of the work, which depends on the result of `align` alone."""
        return self._method.combine(aligned)

    def _check(self, frame: Frame) -> None:
        if self._closed:
            raise FrameError("this corrector is closed: make a new one for more frames")
        if not isinstance(frame, Frame):
            raise FrameError(f"expected a Frame, got {type(frame).__name__}")
        frame.require_shape(self._intrinsics.shape)
        if not frame.stamp_s > self._last_stamp_s:
            raise FrameError(f"time must increase: a frame at {frame.stamp_s} s follows one at {self._last_stamp_s} s")
        self._last_stamp_s = frame.stamp_s


class VoxDepth(StreamCorrector):
    """The default method: a memory of surfaces that moves with the camera.

    Args:
        intrinsics: Intrinsics of the camera. Those of a stereo camera should have a baseline: the method works in
            disparity, and assumes the baseline of a small camera without one.
        config: Parameters; None for the defaults.

    Raises:
        ConfigError: An argument has another type, the images are too small, or the configured device does not exist.
    """

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig | None = None) -> None:
        config = _checked(intrinsics, config, VoxDepthConfig)
        super().__init__(intrinsics, TemporalMethod(intrinsics, config))


class PaperVoxDepth(StreamCorrector):
    """The method of the paper: templates fused from voxels, registered by an affine map, and a median filter.

    Args:
        intrinsics: Intrinsics of the camera.
        config: Parameters; None for those of the paper.

    Raises:
        ConfigError: An argument has another type, or the configured device does not exist.
    """

    def __init__(self, intrinsics: Intrinsics, config: PaperConfig | None = None) -> None:
        config = _checked(intrinsics, config, PaperConfig)
        super().__init__(intrinsics, PaperMethod(intrinsics, config))


def _checked(intrinsics: Intrinsics, config: Config | None, kind: type[Config]) -> Config:
    """The configuration, or the default of that type.

    Raises:
        ConfigError: An argument has another type.
    """
    config = kind() if config is None else config
    if not isinstance(intrinsics, Intrinsics) or type(config) is not kind:
        given = f"{type(intrinsics).__name__} and {type(config).__name__}"
        raise ConfigError(f"this corrector takes Intrinsics and a {kind.__name__}, got {given}")
    return config
