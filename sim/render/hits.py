"""What is seen where: the common ground of the ways to find it."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage, Intrinsics

from ..types import Camera, IdImage

Rays = npt.NDArray[np.float32]
"""Shape (..., 6): origin and direction in the world. Of unit depth in its camera, so what scales it is the depth."""


class Hits(NamedTuple):
    """What rays hit first; the arrays share their leading axes."""

    depth_m: FloatImage
    """+inf where nothing is hit."""
    normal: FloatImage
    """Not normalised, shape (..., 3)."""
    body_index: IdImage
    """Position of the body in the mirror of the world; the last value, one past the bodies, stands for nothing."""


class Sight(Protocol):
    """Finds the first surface behind each pixel."""

    def look(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """Hits of shape (cameras, H * W), of the world as it is now; the rays are those of the pixels."""
        ...


def unit_depth_directions(intrinsics: Intrinsics) -> Rays:
    """Ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
