"""What was measured before: disparity, how sure it is, and how it looked; in the pixels of the newest frame."""

from dataclasses import dataclass

import cv2
import numpy as np

from ..devices import DeviceName
from ..types import FloatArray, FloatImage, GrayImage
from .memory_warper import create_image_mover
from .working_resolution import Scale

UNIT = 16
"""Weights are counted in sixteenths of a measurement that has only valid neighbours."""

COARSE = np.float32(2)
"""Pixels a side of those of the drift, which is the same over a surface."""
OFFSET_PX = (COARSE - 1) / 2
"""Where the middle of the first of those pixels is."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Memory:
    """One surface per pixel."""

    disparity_px: FloatImage
    """Shape (h, w), float32; 0 = nothing is remembered."""
    weight: GrayImage
    """Evidence in sixteenths of a measurement, shape (h, w), uint8."""
    gray: GrayImage
    """How the surface looked when it was measured last, shape (h, w), uint8."""
    drift_px: FloatImage
    """By how much measurements have been nearer than the memory lately, shape (h / 2, w / 2)."""

    @classmethod
    def empty(cls, gray: GrayImage) -> "Memory":
        """Nothing is remembered; whatever is there looks as it does now."""
        return cls(
            disparity_px=np.zeros(gray.shape, np.float32),
            weight=np.zeros_like(gray),
            gray=gray,
            drift_px=np.zeros(_coarse(gray.shape), np.float32),
        )


def _coarse(shape: tuple[int, ...]) -> tuple[int, int]:
    """Of the drift of a memory of shape (h, w)."""
    return max(1, int(shape[0] // COARSE)), max(1, int(shape[1] // COARSE))


class Mover:
    """Moves a memory along with the camera.

    Args:
        scale: Of the memory.
        device: Where disparity and weight are moved; the rest is on the CPU.

    Raises:
        ConfigError: There is no such device here.
    """

    def __init__(self, scale: Scale, device: DeviceName = "cpu") -> None:
        self._reprojection = create_image_mover(device, scale)

    def move(self, memory: Memory, T_now_before: FloatArray) -> Memory:
        """The memory as the camera sees it now, after a motion of shape (4, 4)."""
        moved = self._reprojection.move(memory.disparity_px, memory.weight, T_now_before)
        gray = cv2.remap(memory.gray, moved.source_x, moved.source_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        size = memory.drift_px.shape[::-1]
        x, y = (
            (np.asarray(cv2.resize(source, size, interpolation=cv2.INTER_AREA), np.float32) - OFFSET_PX) / COARSE
            for source in (moved.source_x, moved.source_y)
        )
        drift_px = cv2.remap(memory.drift_px, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return Memory(
            disparity_px=moved.disparity_px,
            weight=moved.weight,
            gray=np.asarray(gray, np.uint8),
            drift_px=np.asarray(drift_px, np.float32),
        )
