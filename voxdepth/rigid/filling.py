"""What neither sensor nor memory knows: occlusion shadows take the background, anything else its surroundings."""

import cv2
import numpy as np
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .masks import above, mean_around, put
from .planes import Planes, PlanesConfig
from .scale import Scale

RIM_PX = 5
"""Window in which the valid neighbours of a pixel are counted: those on the rim of a hole are mostly wrong."""


class FillingConfig(Model):
    """How holes are filled."""

    planes: PlanesConfig = PlanesConfig()
    step_px: float = Field(1.0, gt=0)
    """Disparity by which the right end of a hole must be nearer than the left one for it to be an occlusion shadow."""
    margin_px: float = Field(6.0, ge=0)
    """A shadow is as wide as that step of disparity. Holes that are wider by more than this are something else."""
    inset_px: int = Field(3, ge=0)
    """The background is taken so many pixels from the hole, if it is farther there: the rim itself may be fattened."""


class Filling:
    """Fills all holes of an image of disparity."""

    def __init__(self, scale: Scale, config: FillingConfig) -> None:
        self._scale = scale
        self._config = config
        self._planes = Planes(scale, config.planes)

    def fill(self, disparity_px: FloatImage) -> FloatImage:
        """The image without holes; one without any data stays empty.

        Args:
            disparity_px: Shape (h, w); 0 = hole.
        """
        valid = above(disparity_px, 0)
        n_valid = cv2.countNonZero(valid)
        if n_valid in (0, valid.size):
            return disparity_px
        filled = self._planes.filled(disparity_px, _weights(valid))
        farthest_px = cv2.minMaxLoc(disparity_px, valid)[0]
        np.maximum(filled, np.float32(farthest_px), out=filled)
        self._cast_shadows(disparity_px, filled)
        put(disparity_px, valid, filled)
        return filled

    def _cast_shadows(self, disparity_px: FloatImage, filled: FloatImage) -> None:
        """Give holes that are occlusion shadows of a stereo pair what is to the left of them, in place.

        Of two surfaces the second camera, to the right, sees a strip less of the farther one, left of the nearer one:
        as wide as their disparities differ.
        """
        config, step = self._config, self._scale.step
        width = disparity_px.shape[1]
        # Holes as runs of pixels in the flat image; those that touch its left or right end are no shadows.
        valid = np.zeros(disparity_px.size + 2, np.bool_)
        np.greater(disparity_px.ravel(), 0, out=valid[1:-1])
        edges = np.flatnonzero(valid[1:] != valid[:-1])
        before, after = edges[1:-1:2] - 1, edges[2::2]
        one_row = before // width == after // width
        before, after = before[one_row], after[one_row]
        flat_px = disparity_px.ravel()
        near_px, rim_px = flat_px[after], flat_px[before]
        inset = np.minimum(config.inset_px // step, before % width)
        inner_px = flat_px[before - inset]
        far_px = np.where(inner_px > 0, np.minimum(inner_px, rim_px), rim_px)
        length = after - before - 1
        is_shadow = (near_px > far_px + config.step_px) & (length * step <= near_px - far_px + config.margin_px)
        length = length[is_shadow]
        first = np.repeat(before[is_shadow] + 1 - np.cumsum(length) + length, length)
        filled.ravel()[first + np.arange(len(first))] = np.repeat(far_px[is_shadow], length)


def _weights(valid: GrayImage) -> FloatImage:
    """What a pixel is worth to the planes, 0..1: the fourth power of the share of its valid neighbours."""
    share = mean_around(valid, RIM_PX).astype(np.float32)
    share *= np.float32(1 / 255)
    np.square(share, out=share)
    np.square(share, out=share)
    weight = np.zeros(valid.shape, np.float32)
    put(share, valid, weight)
    return weight
