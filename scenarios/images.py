"""Colours of drones and of invalid pixels, and picture files."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sim.types import InvalidReason
from voxdepth.tools.files import write
from voxdepth.types import GrayImage

from .errors import ScenarioError
from .figure import encoded

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DRONE_COLORS = (
    (240, 120, 20), (30, 120, 220), (40, 160, 80), (150, 90, 210),
    (0, 170, 190), (225, 90, 170), (170, 150, 20), (130, 85, 60),
)  # fmt: skip
"""Colours of the drones, RGB, in their order; they begin again after the last. Red is for collisions."""
INVALID_REASON_COLORS = {
    InvalidReason.OCCLUDED: (230, 60, 60),
    InvalidReason.OUT_OF_RANGE: (200, 60, 200),
    InvalidReason.TEXTURELESS: (40, 140, 230),
    InvalidReason.AMBIGUOUS: (230, 200, 40),
    InvalidReason.SPECKLE: (80, 200, 80),
    InvalidReason.FLICKER: (190, 190, 190),
}
"""Colour of a pixel by the reason why it has no depth, RGB: red, magenta, blue, yellow, green, gray. A pixel with depth
is black."""


def drone_color(drone: int) -> tuple[int, int, int]:
    """Return the colour of a drone in all pictures and recordings, RGB."""
    return DRONE_COLORS[drone % len(DRONE_COLORS)]


def hex_color(color: tuple[int, int, int]) -> str:
    """Return a colour, RGB, as matplotlib takes it."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def color_invalid_reasons(reasons: GrayImage) -> npt.NDArray[np.uint8]:
    """Colour-code the reasons of invalid pixels, shape (H, W, 3), RGB; valid pixels are black."""
    table = np.array([INVALID_REASON_COLORS.get(reason, (0, 0, 0)) for reason in InvalidReason], np.uint8)
    return table[reasons]


def require_picture(path: Path) -> None:
    """Raise a `ScenarioError` if a path names neither a JPEG nor a PNG file."""
    if path.suffix.lower() not in (".jpg", ".jpeg", ".png"):
        raise ScenarioError(f"a picture must be a .jpg or .png file, got {path}")


def save_picture(path: Path, figure: "Figure") -> None:
    """Write a figure as JPEG or PNG; a failure is a `ToolError`."""
    write(path, encoded(figure, "png" if path.suffix.lower() == ".png" else "jpg"))
