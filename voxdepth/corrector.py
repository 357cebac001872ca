"""VoxDepth: the corrector of a stream of frames, by one of two methods."""

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from .checks import require_size
from .config import VoxDepthConfig
from .errors import ConfigError, FrameError
from .paper.config import PaperConfig
from .paper.method import PaperMethod
from .temporal.method import RigidMethod
from .types import CorrectedDepth, Frame, Intrinsics


class Method(Protocol):
    """What `VoxDepth` does to frames that it has checked."""

    def align(self, frame: Frame) -> Any:
        """All that depends on earlier frames."""
        ...

    def combine(self, aligned: Any) -> CorrectedDepth:
        """The rest, from what `align` returned alone."""
        ...

    def reset(self) -> None:
        """Forget all frames."""
        ...

    def close(self) -> None:
        """Wait for what runs beside the calls."""
        ...


METHODS: dict[type, Callable[[Intrinsics, Any], Method]] = {VoxDepthConfig: RigidMethod, PaperConfig: PaperMethod}
"""The methods by the type of their configuration."""


class VoxDepth:
    """Corrects the depth of a stream of frames, which must come in order and from one camera.

    `process` does it all. `CorrectionPipeline` runs the two halves, `align` and `combine`, side by side for
    successive frames.

    Args:
        intrinsics: Of the camera; every frame must have its shape. A stereo camera should name its baseline: the
            default method works in disparity, and without one it assumes that of a small camera.
        config: Its type decides on the method: `VoxDepthConfig()` is the default, `VoxDepthConfig.paper()` the paper's.

    Raises:
        ConfigError: An argument is of another type, or the configuration names a device that is not there.
    """

    uses_gray = True

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig | PaperConfig | None = None) -> None:
        config = VoxDepthConfig() if config is None else config
        if not isinstance(intrinsics, Intrinsics) or type(config) not in METHODS:
            given = f"{type(intrinsics).__name__} and {type(config).__name__}"
            choice = " or a ".join(kind.__name__ for kind in METHODS)
            raise ConfigError(f"VoxDepth needs Intrinsics and perhaps a {choice}, got {given}")
        self._intrinsics = intrinsics
        self._method = METHODS[type(config)](intrinsics, config)
        self._last_stamp_s = -np.inf
        self._closed = False

    def reset(self) -> None:
        """Forget all frames and the time; the next frame is the first."""
        self._method.reset()
        self._last_stamp_s = -np.inf

    def close(self) -> None:
        """Wait for work that is under way beside the calls, and take no more frames.

        Needed by no one but those who want its threads to be gone at once: otherwise they go with the corrector.
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
        """The first half, which holds all state. What it returns is for `combine` alone.

        Raises:
            FrameError: As in `process`.
        """
        self._check(frame)
        return self._method.align(frame)

    def combine(self, aligned: Any) -> CorrectedDepth:
        """The second half. Depends on nothing but what `align` returned, and may run beside it."""
        return self._method.combine(aligned)

    def _check(self, frame: Frame) -> None:
        if self._closed:
            raise FrameError("this corrector is closed: make a new one for more frames")
        if not isinstance(frame, Frame):
            raise FrameError(f"expected a Frame, got {type(frame).__name__}")
        require_size(frame, self._intrinsics)
        if not frame.stamp_s > self._last_stamp_s:
            raise FrameError(f"time must increase: a frame at {frame.stamp_s} s follows one at {self._last_stamp_s} s")
        self._last_stamp_s = frame.stamp_s
