"""Images as people look at them: depth in colours, reasons of holes, titles."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sim.types import InvalidReason
from swarm import colors
from voxdepth.types import FloatImage, GrayImage

from .errors import ScenarioError

Image = npt.NDArray[np.uint8]

FAR_M = 25.0
"""Depth at the blue end of the colours."""
TEXT_HEIGHT_PX = 26
INVALID_REASON_COLORS_BGR = {
    InvalidReason.OCCLUDED: (60, 60, 230),
    InvalidReason.OUT_OF_RANGE: (200, 60, 200),
    InvalidReason.TEXTURELESS: (230, 140, 40),
    InvalidReason.AMBIGUOUS: (40, 200, 230),
    InvalidReason.SPECKLE: (80, 200, 80),
    InvalidReason.FLICKER: (200, 130, 255),
}


def colored(depth_m: FloatImage) -> Image:
    """Depth in colours, near red and far blue, holes black; shape (H, W, 3), BGR. What has no surface counts as far."""
    return colors.colored(depth_m, FAR_M)


def color_invalid_reasons(reasons: GrayImage) -> Image:
    """Reasons of holes in colours, depth black; shape (H, W, 3), BGR."""
    table = np.zeros((len(InvalidReason), 3), np.uint8)
    for reason, color in INVALID_REASON_COLORS_BGR.items():
        table[reason] = color
    image: Image = table[reasons]
    return image


def gray_bgr(gray: npt.NDArray[Any]) -> Image:
    """A gray or boolean image, shape (H, W), with three channels."""
    image = gray.astype(np.uint8) * np.uint8(255 if gray.dtype == np.bool_ else 1)
    return np.repeat(image[..., None], 3, axis=2)


def titled(text: str, image: Image) -> Image:
    """An image under a line of text."""
    bar = np.full((TEXT_HEIGHT_PX, image.shape[1], 3), 245, np.uint8)
    cv2.putText(bar, text, (8, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([bar, image])


def narrowed(image: Image, width_px: int) -> Image:
    """A photograph at a smaller width, as the mean of what falls into a pixel."""
    size = (width_px, round(image.shape[0] * width_px / image.shape[1]))
    smaller: Image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    return smaller


def picked(data: npt.NDArray[Any], width_px: int) -> npt.NDArray[Any]:
    """Depth or labels at a smaller width: single pixels, for means of them would be neither."""
    size = (width_px, round(data.shape[0] * width_px / data.shape[1]))
    kind = np.uint8 if data.dtype == np.bool_ else data.dtype
    return cv2.resize(data.astype(kind), size, interpolation=cv2.INTER_NEAREST).astype(data.dtype)


def require_picture(path: Path) -> None:
    """Refuse names that `save_picture` would, before anything is computed.

    Raises:
        ScenarioError: It is neither a JPEG nor a PNG file.
    """
    if path.suffix.lower() not in (".jpg", ".jpeg", ".png"):
        raise ScenarioError(f"a picture must be a .jpg or .png file, got {path}")


def save_picture(path: Path, image: Image, *, quality: int = 85) -> None:
    """Write a JPEG or PNG file.

    Raises:
        ScenarioError: It cannot be written.
    """
    require_picture(path)
    settings = [] if path.suffix.lower() == ".png" else [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, encoded = cv2.imencode(path.suffix, image, settings)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(encoded.tobytes())
    except OSError as error:
        raise ScenarioError(f"cannot write the picture {path}: {error.strerror}") from error
