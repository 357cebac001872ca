"""The interface of visibility backends, which find the first surface behind each pixel."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage

from ..types import Camera, IdImage

Rays = npt.NDArray[np.float32]
"""Origin and direction in the world frame, shape (..., 6). Directions have z = 1 in their camera's frame, so that the
ray parameter is the depth."""


class Hits(NamedTuple):
    """First hits of rays; the arrays share their leading axes."""

    depth_m: FloatImage
    """Depth [m]; +inf without a hit."""
    normal: FloatImage
    """Surface normal, not normalised, shape (..., 3)."""
    body_index: IdImage
    """Index of the body in `SceneMeshes.body_ids`, or their number without a hit."""


class VisibilityBackend(Protocol):
    """Finds the first surface behind each pixel."""

    def first_hits(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """Hits of shape (cameras, H * W) in the present state of the world; there is one ray per pixel."""
        ...
