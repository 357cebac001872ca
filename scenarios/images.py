"""Images for people: colour-coded depth, colour-coded reasons of invalid pixels, titles, and picture files."""

from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sim.types import InvalidReason
from voxdepth.colors import FAR_M
from voxdepth.tools.files import write
from voxdepth.types import FloatImage, GrayImage

from .errors import ScenarioError

Image = npt.NDArray[np.uint8]

DRONE_COLORS = (
    (240, 120, 20), (30, 120, 220), (40, 160, 80), (150, 90, 210),
    (0, 170, 190), (225, 90, 170), (170, 150, 20), (130, 85, 60),
)  # fmt: skip
"""Colours of the drones, RGB, in their order; they begin again after the last. Red is for collisions."""
TEXT_HEIGHT_PX = 26
TEXT_PX, SMALL_TEXT_PX = 15, 12
"""Sizes of the letters of titles, and of those below a scale."""
WHITE, INK = 245, (30, 30, 30)
"""Levels of the ground that texts are written on, and of the texts."""
TICKS_M = range(0, int(FAR_M) + 1, 5)
"""Ticks of the scale of depth; the last one includes all farther depths."""
SCALE_PX, LINE_PX = 14, 18
"""Height of the scale of depth, and of a line of small text."""
INVALID_REASON_COLORS_BGR = {
    InvalidReason.OCCLUDED: (60, 60, 230),
    InvalidReason.OUT_OF_RANGE: (200, 60, 200),
    InvalidReason.TEXTURELESS: (230, 140, 40),
    InvalidReason.AMBIGUOUS: (40, 200, 230),
    InvalidReason.SPECKLE: (80, 200, 80),
    InvalidReason.FLICKER: (190, 190, 190),
}
"""Colour of a pixel by the reason why it has no depth: red, magenta, blue, yellow, green, gray. A pixel with depth is
black."""


def drone_color(drone: int) -> tuple[int, int, int]:
    """Return the colour of a drone in all pictures and recordings, RGB."""
    return DRONE_COLORS[drone % len(DRONE_COLORS)]


def color_invalid_reasons(reasons: GrayImage) -> Image:
    """Colour-code the reasons of invalid pixels, shape (H, W, 3), BGR; valid pixels are black."""
    table = np.zeros((len(InvalidReason), 3), np.uint8)
    for reason, color in INVALID_REASON_COLORS_BGR.items():
        table[reason] = color
    image: Image = table[reasons]
    return image


def gray_bgr(gray: npt.NDArray[Any]) -> Image:
    """Convert a gray or boolean image, shape (H, W), to three channels."""
    image = gray.astype(np.uint8) * np.uint8(255 if gray.dtype == np.bool_ else 1)
    return np.repeat(image[..., None], 3, axis=2)


def titled(text: str, image: Image) -> Image:
    """Add a line of text above an image."""
    bar = np.full((TEXT_HEIGHT_PX, image.shape[1], 3), WHITE, np.uint8)
    cv2.putText(bar, text, (8, 18), INK, _font(), TEXT_PX)
    return np.vstack([bar, image])


def text_line(width_px: int, texts: Mapping[int, str]) -> Image:
    """Return a line of small texts by their first columns; a text that does not fit is moved to the left."""
    line = np.full((LINE_PX, width_px, 3), WHITE, np.uint8)
    for start_px, text in texts.items():
        _, _, length_px, _ = cv2.getTextSize((width_px, LINE_PX), text, (0, 0), _font(), SMALL_TEXT_PX)
        at = (max(0, min(start_px, width_px - length_px - 2)), LINE_PX - 5)
        cv2.putText(line, text, at, INK, _font(), SMALL_TEXT_PX)
    return line


def depth_scale(width_px: int, paint: Callable[[FloatImage], Image]) -> Image:
    """Return the colours that `paint` gives to depths from 0 m to the farthest one, above their numbers."""
    depth_m = np.tile(np.linspace(0.01, FAR_M, width_px, dtype=np.float32), (SCALE_PX, 1))
    ticks = {round(tick_m / FAR_M * width_px): f"{tick_m} m" for tick_m in TICKS_M[:-1]}
    ticks[width_px] = f">{TICKS_M[-1]} m"
    return np.vstack([paint(depth_m), text_line(width_px, ticks)])


@cache
def _font() -> cv2.FontFace:
    """The font of OpenCV in which a zero looks like the other digits."""
    return cv2.FontFace("uni")


def narrowed(image: Image, width_px: int) -> Image:
    """Reduce a photograph to a width; a pixel is the mean of the pixels that it covers."""
    size = (width_px, round(image.shape[0] * width_px / image.shape[1]))
    smaller: Image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    return smaller


def require_picture(path: Path) -> None:
    """Raise a `ScenarioError` if a path names neither a JPEG nor a PNG file."""
    if path.suffix.lower() not in (".jpg", ".jpeg", ".png"):
        raise ScenarioError(f"a picture must be a .jpg or .png file, got {path}")


def save_picture(path: Path, image: Image, *, quality: int = 85) -> None:
    """Write a JPEG or PNG file; a failure is a `ToolError`."""
    require_picture(path)
    settings = [] if path.suffix.lower() == ".png" else [cv2.IMWRITE_JPEG_QUALITY, quality]
    _, encoded = cv2.imencode(path.suffix, image, settings)
    write(path, encoded.tobytes())
