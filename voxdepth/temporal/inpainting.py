"""What neither sensor nor memory knows: shadows of occlusion, planes, the ground and what stands on it."""

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage, GrayImage
from .estimate import CHANCES
from .ground import GroundConfig, found_ground
from .masks import above, mean_around, put
from .planes import Planes, PlanesConfig
from .stixels import Feet, StandingConfig
from .working_resolution import Scale

Indices = npt.NDArray[np.intp]

BACKGROUND_PX = (3, 6)
"""How far from a hole the background is looked at besides its rim, in pixels of the full image."""
RIM_PX = 5
"""Window in which the valid neighbours of a pixel are counted: those on the rim of a hole are mostly wrong."""


class FillingConfig(Model):
    """How holes are filled."""

    planes: PlanesConfig = PlanesConfig()
    ground: GroundConfig = GroundConfig()
    standing: StandingConfig = StandingConfig()
    step_px: float = Field(1.0, gt=0)
    """Disparity by which the right end of a hole must be nearer than the left one for it to be an occlusion shadow."""
    margin_px: float = Field(6.0, ge=0)
    """A shadow is as wide as that step of disparity. Holes that are wider by more than this are something else."""
    hidden_side: Literal["left", "right"] = "left"
    """Side of near things on which a strip of what is behind them has no depth: the left one where depth is that of
    the left one of two cameras; a projector or a second camera on the left side makes it the right one."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Filled:
    """An image without holes."""

    disparity_px: FloatImage
    """Shape (h, w); 0 only if nothing at all was measured."""
    chance: FloatImage
    """Chance in 0..1 that what was filled is of the right surface, shape (h, w); anything where it was measured."""


class Filling:
    """Fills all holes of an image of disparity."""

    def __init__(self, scale: Scale, config: FillingConfig) -> None:
        self._scale = scale
        self._config = config
        self._planes = Planes(scale, config.planes)
        self._feet = Feet(scale, self._planes.cell_px, config.standing)

    def fill(self, disparity_px: FloatImage) -> Filled:
        """The image without holes; one without any data stays empty.

        Args:
            disparity_px: Shape (h, w); 0 = hole.
        """
        valid = above(disparity_px, 0)
        n_valid = cv2.countNonZero(valid)
        if n_valid in (0, valid.size):
            return Filled(disparity_px=disparity_px, chance=np.zeros_like(disparity_px))
        sums = self._planes.summed(disparity_px, _share_of_neighbours(valid))
        ground = found_ground(*self._planes.cells(sums), self._planes.rows, self._config.ground)
        standing = None if ground is None else self._feet.standing(disparity_px, ground)
        filled_px, chance = self._planes.filled(sums, standing)
        farthest_px = cv2.minMaxLoc(disparity_px, valid)[0]
        np.maximum(filled_px, np.float32(farthest_px), out=filled_px)
        if self._config.hidden_side == "left":
            self._cast_shadows(disparity_px, filled_px, chance)
        else:
            self._cast_shadows(disparity_px[:, ::-1], filled_px[:, ::-1], chance[:, ::-1])
        put(disparity_px, valid, filled_px)
        return Filled(disparity_px=filled_px, chance=chance)

    def _cast_shadows(self, disparity_px: FloatImage, filled_px: FloatImage, chance: FloatImage) -> None:
        """Give holes that are occlusion shadows of a stereo pair what is to the left of them, in place.

        Of two surfaces the second camera, to the right, sees a strip less of the farther one, left of the nearer one:
        as wide as their disparities differ.
        """
        config, step = self._config, self._scale.step
        width = disparity_px.shape[1]
        flat_px = np.ascontiguousarray(disparity_px).ravel()
        # Holes as runs of pixels in the flat image; those that touch an end of their row are no shadows.
        valid = np.zeros(flat_px.size + 2, np.bool_)
        np.greater(flat_px, 0, out=valid[1:-1])
        edges = np.flatnonzero(valid[1:] != valid[:-1])
        before, after = edges[1:-1:2] - 1, edges[2::2]
        one_row = before // width == after // width
        before, after = before[one_row], after[one_row]
        near_px, far_px = flat_px[after], _background(flat_px, before, width, step)
        length = after - before - 1
        is_shadow = (near_px > far_px + config.step_px) & (length * step <= near_px - far_px + config.margin_px)
        length = length[is_shadow]
        first = np.repeat(before[is_shadow] + 1 - np.cumsum(length) + length, length)
        row, col = np.divmod(first + np.arange(len(first)), width)
        filled_px[row, col] = np.repeat(far_px[is_shadow], length)
        chance[row, col] = CHANCES.shadow


def _background(flat_px: FloatImage, rim: Indices, width: int, step: int) -> FloatImage:
    """Disparity left of holes: the middle one of three pixels, for the rim may be fattened and any one an outlier.

    Args:
        flat_px: The image, flat.
        rim: Index of the last pixel before each hole, shape (N,).
        width: Of the image.
        step: Pixels of the full image per pixel.
    """
    away = np.array([[0], *([pixels // step] for pixels in BACKGROUND_PX)])
    three_px = flat_px[rim - np.minimum(away, rim % width)]
    three_px = np.where(three_px > 0, three_px, three_px[0])
    middle: FloatImage = np.sort(three_px, axis=0)[1]
    return middle


def _share_of_neighbours(valid: GrayImage) -> FloatImage:
    """Of the pixels around each valid one those that are valid, 0..1, shape (h, w); 0 in holes."""
    around = mean_around(valid, RIM_PX).astype(np.float32)
    around *= np.float32(1 / 255)
    share = np.zeros(valid.shape, np.float32)
    put(around, valid, share)
    return share
