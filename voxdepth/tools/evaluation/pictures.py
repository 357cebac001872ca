"""Small pictures of one frame of a sequence, PNG in base64 for pages; all depths of it have the same colours."""

import base64
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ...colors import ERROR_END, ERROR_STEP, colored, error_colored, far_end_m
from ...types import FloatImage
from ..output import encode
from .frames import EvaluationFrame, Reference

WIDTH_PX = 300
"""Width of a picture."""


def far_end_of(frame: EvaluationFrame) -> float:
    """Return the depth at the blue end of the colours of a frame [m]."""
    return far_end_m([frame.reference_m, frame.frame.depth_m])


def scene_pictures(frame: EvaluationFrame) -> tuple[str, str]:
    """Draw the gray image of a frame, and its reference."""
    return _png(frame.frame.gray), _png(colored(frame.reference_m, far_end_of(frame)))


def depth_pictures(depth_m: FloatImage, frame: EvaluationFrame, reference: Reference) -> tuple[str, ...]:
    """Draw a depth [m] of a frame, shape (H, W), and its errors if the truth is known."""
    depth = _png(colored(depth_m, far_end_of(frame)))
    return (depth, _png(error_colored(depth_m, frame.reference_m))) if reference.is_true else (depth,)


def depth_scale(far_m: float) -> str:
    """Draw the colours of depth from 0 to `far_m`."""
    return _png(colored(np.linspace(far_m / WIDTH_PX, far_m, WIDTH_PX, dtype=np.float32)[None], far_m))


def error_scale() -> str:
    """Draw the colours of relative errors from `-ERROR_END` to `ERROR_END`, equally wide."""
    end = ERROR_END + ERROR_STEP / 2
    depth_m = np.linspace(1 - end, 1 + end, WIDTH_PX, dtype=np.float32)[None]
    return _png(error_colored(depth_m, np.ones_like(depth_m)))


def _png(image: npt.NDArray[Any]) -> str:
    """Shrink an image, gray or in colours; those of depth are not mixed, so that holes stay black."""
    height_px = max(1, round(WIDTH_PX * image.shape[0] / image.shape[1]))
    interpolation = cv2.INTER_AREA if image.ndim == 2 else cv2.INTER_NEAREST
    small = cv2.resize(image, (WIDTH_PX, height_px), interpolation=interpolation)
    return base64.b64encode(encode(small, level=9)).decode()
