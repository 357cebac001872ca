"""A temporal filter that follows the image: the previous corrected depth is moved by dense optical flow.

In the manner of the temporal depth filters that the paper cites (Matyunin et al. 2011, Avetisyan et al. 2016). It
follows moving things, too, but knows nothing of how depth itself changes on the way.
"""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import ConfigError
from ..types import CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics
from .flows import Dis, Flow, FlowImage
from .inferred import inferred

MAX_CIRCLE_PX = 1.0
"""Flow there and back may miss its start by this; farther off, one of the two is wrong or the point is hidden."""


LAST_PX = 32767
"""Columns and rows are given to OpenCV in 16 bits."""

AgeImage = npt.NDArray[np.int16]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Memory:
    """The last corrected frame."""

    gray: GrayImage
    depth_m: FloatImage
    """Shape (H, W); 0 = invalid."""
    age: AgeImage
    """Frames since the pixel was measured, shape (H, W)."""


class FlowFilter:
    """Blends measured depth with the moved one where they agree, and fills holes from it."""

    uses_gray = True

    def __init__(
        self,
        intrinsics: Intrinsics,
        *,
        flow: Flow | None = None,
        alpha: float = 0.4,
        agreement: float = 0.05,
        max_age_frames: int = 30,
    ) -> None:
        """A filter for one camera.

        Args:
            intrinsics: Frames of another size are refused.
            flow: `Dis()` unless another is named.
            alpha: Weight of the measured depth where both agree, in (0, 1]; less of it is steadier and lags more.
            agreement: Largest difference of the two, as a share of the measured depth.
            max_age_frames: A hole is filled for this many frames after its point was last measured.

        Raises:
            ConfigError: A parameter is out of range.
        """
        if not 0 < alpha <= 1 or not 0 <= agreement < np.inf or max_age_frames < 1:
            raise ConfigError(
                "expected an alpha in (0, 1], an agreement of at least 0 and a max_age_frames of at least 1, got "
                f"{alpha}, {agreement} and {max_age_frames}"
            )
        self._intrinsics = intrinsics
        self._flow = flow or Dis()
        self._alpha = np.float32(alpha)
        self._agreement = np.float32(agreement)
        self._max_age_frames = max_age_frames
        self._memory: _Memory | None = None

    def process(self, frame: Frame) -> CorrectedDepth:
        """The frame, blended with the one before; the first of a stream comes back as it is.

        Raises:
            FrameError: The frame has another size than the camera.
        """
        frame.require_shape(self._intrinsics.shape)
        moved_m, age = self._moved(frame.gray)
        depth_m = self._blended(frame.depth_m, moved_m)
        age[frame.depth_m > 0] = 0
        self._memory = _Memory(gray=frame.gray.copy(), depth_m=depth_m.copy(), age=age)
        return inferred(frame, depth_m)

    def reset(self) -> None:
        """Forget the last frame."""
        self._memory = None

    def _moved(self, gray: GrayImage) -> tuple[FloatImage, AgeImage]:
        """The last corrected depth [m] where its points are now, 0 = unknown, and its age [frames]; both (H, W)."""
        memory = self._memory
        if memory is None:
            return np.zeros(gray.shape, np.float32), np.zeros(gray.shape, np.int16)
        to_memory_px = self._flow.between(gray, memory.gray)
        landing = _landing(to_memory_px)
        circle_px = to_memory_px + _taken(self._flow.between(memory.gray, gray), landing)
        closed = cv2.magnitude(circle_px[..., 0], circle_px[..., 1]) <= MAX_CIRCLE_PX
        age = _taken(memory.age, landing) + np.int16(1)
        trusted = closed & (age <= self._max_age_frames)
        return np.where(trusted, _taken(memory.depth_m, landing), np.float32(0)), age

    def _blended(self, measured_m: FloatImage, moved_m: FloatImage) -> FloatImage:
        """Measured and moved depth [m] where they agree, else the measured one, in holes the moved one."""
        difference_m = moved_m - measured_m
        agree = (moved_m > 0) & (np.abs(difference_m) <= self._agreement * measured_m)
        blended_m = np.where(agree, measured_m + (1 - self._alpha) * difference_m, measured_m)
        return np.where(measured_m > 0, blended_m, moved_m)


def _landing(flow_px: FlowImage) -> npt.NDArray[np.int16]:
    """Column and row of the pixel that each pixel flows to, shape (H, W, 2); beside the image if it leaves it."""
    height, width = flow_px.shape[:2]
    landing = flow_px.copy()
    landing[..., 0] += np.arange(width, dtype=np.float32)
    landing[..., 1] += np.arange(height, dtype=np.float32)[:, None]
    return np.rint(np.clip(landing, -1, np.float32(LAST_PX), out=landing), out=landing).astype(np.int16)


def _taken(image: Any, landing: npt.NDArray[np.int16]) -> Any:
    """The pixels of an image that were landed on, never mixtures of them; 0 beside it."""
    return cv2.remap(image, landing, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)  # type: ignore[call-overload]
