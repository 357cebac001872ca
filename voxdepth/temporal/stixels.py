"""What stands on the ground stands upright: the disparity that it has at its foot, it has all the way up."""

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage, MaskImage
from .estimate import CHANCES, Estimate, Grid
from .ground import Ground, Vector
from .working_resolution import Scale

ROW_PX = 4
"""Of the full image every so many rows are looked at."""
FEET = 5
"""Of so many columns side by side the middle foot is taken."""
LEAST_ROWS = 8
"""Rows of a column that must be on the ground, or at least half of those up to a foot, or it is a wrong match."""
BETWEEN = 2
"""Measured rows between a foot and a hole that do not yet part them: ground is ragged where its texture ends."""
FAR_LEVEL = 2
"""Cells of 2 to the power of this times the smallest size take what stands there even behind other things; the smallest
ones only what nothing is before."""
LEAST_FAR_SHARE, LEAST_BARE_SHARE = 0.25, 0.5
"""Part of a large cell that must have something upright, and of a smallest one that must be a hole above a foot."""
THROUGH = 0.97
"""Part of the disparity of the ground that what is filled there has at least: the plane is not exact."""
ON_GROUND = 1.05
"""What is filled with no more than this part of the disparity of the ground is taken for the ground."""


class StandingConfig(Model):
    """What counts as on the ground."""

    tolerance_px: float = Field(0.5, ge=0)
    """A measurement is on the ground if it is off by no more than this, plus `tolerance` of its disparity."""
    tolerance: float = Field(0.05, ge=0)
    """See `tolerance_px`. Something farther is seen if it is farther by `tolerance_px` and twice this part."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Standing:
    """Disparity [px] of what stands on the ground, in cells; 0 = nothing does."""

    behind_px: Grid
    """Whatever is before it, in cells of `FAR_LEVEL`."""
    bare_px: Grid
    """In holes that begin at its foot, in the smallest cells, shape (rows, cols)."""
    ground_px: Grid
    """Of the ground itself, in the smallest cells, shape (rows, cols); below 0 above the horizon."""

    def laid_over(self, estimate: Estimate, level: int) -> Estimate:
        """An estimate with what stands there instead; in the end nothing below the ground.

        Args:
            estimate: Of cells of a level.
            level: Cells are `2**level` times the smallest size.
        """
        if level == FAR_LEVEL:
            return estimate.replaced(self.behind_px, CHANCES.behind, self.behind_px > 0)
        if level == 0:
            estimate = estimate.replaced(self.bare_px, CHANCES.bare, self.bare_px > 0)
            value_px = np.maximum(estimate.value_px, THROUGH * self.ground_px)
            on_ground = value_px < ON_GROUND * self.ground_px
            return Estimate(value_px=value_px, chance=np.where(on_ground, CHANCES.ground, estimate.chance))
        return estimate


class Feet:
    """Finds what stands on the ground in images of one size.

    In every column the highest measurement that is on the ground is the foot of what is above it. That one is upright:
    the holes above have the disparity of the foot, until something farther is seen above it.
    """

    def __init__(self, scale: Scale, cell_px: int, config: StandingConfig) -> None:
        """With the cells of `Planes`: `cell_px` pixels of the memory wide and high."""
        self._config = config
        self._row_step = ROW_PX // scale.step
        self._cell_px = cell_px
        height, width = scale.shape
        rows, cols = -(-height // cell_px), -(-width // cell_px)
        self._shape = (rows, cols)
        self._left = (cols * cell_px - width) // 2
        from_top = np.arange(0, height, self._row_step)
        self._v = np.asarray((from_top[::-1] + 0.5) / cell_px - rows / 2, np.float64)
        self._height = np.arange(1, len(from_top) + 1, dtype=np.int16)[:, None]
        self._u = np.asarray((np.arange(width) + 0.5 - width / 2) / cell_px, np.float64)

    def standing(self, disparity_px: FloatImage, ground: Ground) -> Standing:
        """What stands on the ground.

        Args:
            disparity_px: Shape (h, w); 0 = hole.
            ground: See there.
        """
        config = self._config
        image_px = np.ascontiguousarray(disparity_px[:: self._row_step][::-1])  # from the bottom up
        measured = image_px > 0
        ground_px = ground.at(self._u, self._v[:, None]).astype(np.float32)
        off_px = cv2.absdiff(image_px, ground_px)
        on_it = (off_px < config.tolerance_px + np.float32(config.tolerance) * ground_px) & measured & (ground_px > 0)
        foot = np.max(on_it * self._height, axis=0)
        foot[np.count_nonzero(on_it, axis=0) < np.minimum(LEAST_ROWS, foot / 2)] = 0
        foot_px = np.where(foot > 0, image_px[foot - 1, np.arange(len(foot))], np.float32(0))
        foot_px = np.asarray(cv2.medianBlur(foot_px[None], FEET), np.float32)
        least_px = foot_px - (config.tolerance_px + 2 * np.float32(config.tolerance) * foot_px)
        above = self._height > np.where(foot_px > 0, foot, len(image_px))
        measured &= above
        upright = above & (_met_below(measured & (image_px < least_px)) == 0)
        bare = above & (_met_below(measured) <= BETWEEN)
        rows, cols = self._shape
        return Standing(
            behind_px=self._in_cells(foot_px, upright, 2**FAR_LEVEL, LEAST_FAR_SHARE),
            bare_px=self._in_cells(foot_px, bare, 1, LEAST_BARE_SHARE),
            ground_px=ground.at(_middles(cols), _middles(rows)[:, None]),
        )

    def _in_cells(self, foot_px: FloatImage, where: MaskImage, size: int, least_share: float) -> Grid:
        """Mean of the feet of all pixels of a mask, by cells [px]; 0 where it covers less than `least_share` of a cell.

        Args:
            foot_px: Of each column, shape (w,).
            where: From the bottom up, one of `ROW_PX` rows, shape (N, w).
            size: Of the cells, in smallest ones.
            least_share: 0..1.
        """
        rows, cols = -(-self._shape[0] // size), -(-self._shape[1] // size)
        height, width = self._cell_px * size // self._row_step, self._cell_px * size
        covered = np.zeros((rows * height, cols * width), np.float32)
        inside = np.s_[self._left : self._left + where.shape[1]]
        covered[: where.shape[0], inside] = where[::-1]
        feet_px = covered.copy()
        feet_px[:, inside] *= foot_px
        share, mean_px = (cv2.resize(i, (cols, rows), interpolation=cv2.INTER_AREA) for i in (covered, feet_px))
        return np.where(share >= least_share, mean_px / np.maximum(share, np.float32(1e-6)), np.float32(0))


def _met_below(where: MaskImage) -> npt.NDArray[np.int16]:
    """How many pixels of a mask each one has in its column, itself and those below it; from the bottom up."""
    return np.cumsum(where, axis=0, dtype=np.int16)


def _middles(cells: int) -> Vector:
    """Of the cells along one side, in cells from the middle of the image."""
    return np.arange(cells, dtype=np.float64) - (cells - 1) / 2
