"""Holes filled by planes: moving least squares of first order in disparity, where planes are linear."""

from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model
from ..types import FloatImage
from .estimate import CHANCES, Estimate, Grid
from .ground import Vector
from .stixels import Standing
from .working_resolution import Scale

Sums = list[Grid]
"""Sums around each cell, shape (N_MOMENTS, rows, cols), for each size of cells, the smallest first."""

Values = TypeVar("Values", FloatImage, Grid)

INSIDE, OUTSIDE = 3.0, 5.0
"""Squared distances from the data, in their standard deviations, from which on planes are extended less to the far
side, and not at all: what nobody measured is not made out to be far away."""
N_MOMENTS = 11
"""Weighted sums per cell: of 1, u, v, uu, uv, vv, D, uD, vD, DD; and how much is present at all."""
OF_DISPARITY = 6
"""Which of them is that of D."""
LEAST_PRESENT = 0.1
"""Part of a cell that must be measured for its mean to count."""
MOST_ROWS = 32
"""Rows of cells whose means are looked at, at most."""
POWERS = ((0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0))
"""Powers of v and of u in the first six of them."""


class PlanesConfig(Model):
    """How planes are fitted around holes."""

    cell_px: int = Field(16, ge=4)
    """Side of the finest cells, in pixels of the full image; smaller follows closer what is near a hole, and costs
    more."""
    enough: float = Field(0.08, gt=0)
    """Part of a cell's neighbourhood that must be measured for its own plane to count in full; what is missing is
    taken from cells of twice the size, and so on."""
    ridge: float = Field(0.003, gt=0)
    """Pulls slopes to 0 against the spread of the data; more extends planes less far."""
    below: float = Field(1.25, ge=0)
    """A plane is not extended to farther than so many standard deviations of its data, nor than their mean where it
    leaves them."""
    above: float = Field(2.5, ge=0)
    """Nor to nearer than so many."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Planes:
    """What the planes of cells of one size say."""

    estimate: Estimate
    """In the middle of each cell, with the chance of planes of that size."""
    density: Grid
    """How much was measured around each cell, 0..1, shape (rows, cols)."""


class Planes:
    """Extends what was measured into holes.

    Every cell has the plane that fits the data in its neighbourhood best (three by three cells, by weight), at every
    power of two of its size. The smallest size with enough data decides, and blends into the next.
    """

    def __init__(self, scale: Scale, config: PlanesConfig) -> None:
        """For images of the memory's size."""
        self._config = config
        shape = scale.shape
        self.cell_px = cell = config.cell_px // scale.step
        rows, cols = -(-shape[0] // cell), -(-shape[1] // cell)
        self.rows = rows
        self._padded = (rows * cell, cols * cell)
        # Cells stick out as far to the left as to the right: those of the mirror image are their mirror image.
        left = (cols * cell - shape[1]) // 2
        self._inside = (slice(shape[0]), slice(left, left + shape[1]))
        self._levels = max(1, int(np.log2(max(rows, cols))))
        # Coordinates are in cells, from the middle of the image.
        self._powers_v = _powers(rows, cell).swapaxes(1, 2)
        self._powers_u = _powers(cols, cell)

    def summed(self, disparity_px: FloatImage, share: FloatImage) -> Sums:
        """What the planes are fitted to.

        Args:
            disparity_px: Shape (h, w).
            share: Of the neighbours of each pixel those that are valid, 0..1, shape (h, w), float32; 0 in holes.
        """
        presence = np.square(share)
        moments = self._moments(disparity_px, presence)
        sums = [_neighbourhood(moments)]
        for _ in range(self._levels):
            moments = _halved(moments)
            sums.append(_neighbourhood(moments))
        return sums

    def cells(self, sums: Sums) -> tuple[Vector, Vector, Vector]:
        """Column and row, in cells from the middle of the image, and mean disparity [px] of measured cells, shape (N,).

        Of images with more than `MOST_ROWS` rows of cells every second one, or every third, ...
        """
        n, u, v, *_ = rows = sums[0][:, :: -(-sums[0].shape[1] // MOST_ROWS)]
        known = rows[-1] > LEAST_PRESENT * self.cell_px**2
        n = n[known]
        return u[known] / n, v[known] / n, rows[OF_DISPARITY][known] / n

    def filled(self, sums: Sums, standing: Standing | None = None) -> tuple[FloatImage, FloatImage]:
        """Planes through the data, in every pixel; far from the data what stands on the ground.

        Args:
            sums: See `summed`.
            standing: What stands on the ground; None if no ground was found.

        Returns:
            Disparity [px], and the chance in 0..1 that it is of the right surface, both of shape (h, w).
        """
        estimate: Estimate | None = None
        for level in range(self._levels, -1, -1):
            planes = self._fitted(sums[level], level)
            estimate = planes.estimate if estimate is None else _blended(planes, estimate)
            if standing is not None:
                estimate = standing.laid_over(estimate, level)
        assert estimate is not None
        disparity_px = _enlarged(estimate.value_px.astype(np.float32), self.cell_px)
        chance = _resized(estimate.chance.astype(np.float32), self.cell_px)
        return np.ascontiguousarray(disparity_px[self._inside]), np.ascontiguousarray(chance[self._inside])

    def _moments(self, disparity_px: FloatImage, presence: FloatImage) -> Grid:
        """Sums per cell, shape (N_MOMENTS, rows, cols), weighted by the fourth power of the share of neighbours."""
        weight = np.square(presence)
        weighted = weight * disparity_px
        plain, first, second = self._sums(weight, 6), self._sums(weighted, 3), self._sums(weighted * disparity_px, 1)
        present = self._sums(presence, 1)
        return np.concatenate([plain, first, second, present]).astype(np.float64)

    def _sums(self, image: FloatImage, n: int) -> npt.NDArray[np.float32]:
        """Sums per cell of the image times 1, u, v, uu, uv, vv: the first n of them, shape (n, rows, cols)."""
        rows, cell, cols = len(self._powers_v), self.cell_px, len(self._powers_u)
        padded = np.zeros(self._padded, np.float32)
        padded[self._inside] = image
        down = np.matmul(self._powers_v, padded.reshape(rows, cell, -1)).reshape(rows * 3, cols, cell)
        sums = np.matmul(down.swapaxes(0, 1), self._powers_u).reshape(cols, rows, 3, 3)
        return np.stack([sums[:, :, of_v, of_u].T for of_v, of_u in POWERS[:n]])

    def _fitted(self, sums: Grid, level: int) -> _Planes:
        """The plane of each cell, in its middle, by the sums around it."""
        config, size = self._config, 2.0**level
        n, u, v, uu, uv, vv, d, ud, vd, dd, present = sums
        density = present / (self.cell_px * size) ** 2
        n = np.maximum(n, 1e-9)
        u, v, d = u / n, v / n, d / n
        uu, uv, vv = uu / n - u * u, uv / n - u * v, vv / n - v * v
        ud, vd = ud / n - u * d, vd / n - v * d
        ridge = config.ridge * size**2
        uu, vv = uu + ridge, vv + ridge
        determinant = uu * vv - uv * uv
        slope_u, slope_v = (vv * ud - uv * vd) / determinant, (uu * vd - uv * ud) / determinant
        middle_v = (np.arange(n.shape[0])[:, None] + 0.5) * size - self._padded[0] / self.cell_px / 2
        middle_u = (np.arange(n.shape[1])[None] + 0.5) * size - self._padded[1] / self.cell_px / 2
        away_u, away_v = middle_u - u, middle_v - v
        value = d + slope_u * away_u + slope_v * away_v
        spread = np.sqrt(np.maximum(dd / n - d * d, 0))
        # How far the middle is from the data, in their standard deviations, squared.
        outside = (vv * away_u**2 - 2 * uv * away_u * away_v + uu * away_v**2) / determinant
        inside = np.clip((OUTSIDE - outside) / (OUTSIDE - INSIDE), 0, 1)
        value = np.clip(value, d - config.below * inside * spread, d + config.above * spread)
        chance = np.full_like(value, CHANCES.plane(level))
        estimate = Estimate(value_px=value, chance=chance)
        return _Planes(estimate=estimate, density=np.minimum(density / config.enough, 1))


def _powers(cells: int, cell_px: int) -> npt.NDArray[np.float32]:
    """1, x and x squared of the pixels along one side, in cells from the middle, shape (cells, cell_px, 3)."""
    x = (np.arange(cells * cell_px) + 0.5) / cell_px - cells / 2
    return np.stack([x**0, x, x**2], 1).reshape(cells, cell_px, 3).astype(np.float32)


def _neighbourhood(moments: Grid) -> Grid:
    """Sums over three by three cells, the outer ones for less; their weights add up to 1."""
    padded = _framed(moments, 1, 1, 1)
    rows = 0.25 * (padded[:, :-2] + padded[:, 2:]) + 0.5 * padded[:, 1:-1]
    around: Grid = 0.25 * (rows[:, :, :-2] + rows[:, :, 2:]) + 0.5 * rows[:, :, 1:-1]
    return around


def _framed(moments: Grid, before: int, rows_after: int, cols_after: int) -> Grid:
    """Moments with zeros around."""
    n, rows, cols = moments.shape
    framed = np.zeros((n, before + rows + rows_after, before + cols + cols_after))
    framed[:, before : before + rows, before : before + cols] = moments
    return framed


def _halved(moments: Grid) -> Grid:
    """Sums of two by two cells."""
    _, rows, cols = moments.shape
    padded = _framed(moments, 0, rows % 2, cols % 2)
    halved: Grid = padded[:, ::2, ::2] + padded[:, 1::2, ::2] + padded[:, ::2, 1::2] + padded[:, 1::2, 1::2]
    return halved


def _blended(fine: _Planes, coarse: Estimate) -> Estimate:
    """The fine planes as far as there are data for them, else the coarse ones."""
    rows, cols = fine.density.shape
    value_px, chance = _enlarged(coarse.value_px, 2)[:rows, :cols], _resized(coarse.chance, 2)[:rows, :cols]
    return Estimate(
        value_px=fine.density * fine.estimate.value_px + (1 - fine.density) * value_px,
        chance=fine.density * fine.estimate.chance + (1 - fine.density) * chance,
    )


def _extended(values: Values) -> Values:
    """One more row at both ends, in line with the outermost two; a single one stays as it is."""
    if len(values) == 1:
        return values
    extended: Values = np.concatenate([2 * values[:1] - values[1:2], values, 2 * values[-1:] - values[-2:-1]])
    return extended


def _enlarged(values: Values, factor: int) -> Values:
    """The values of cells in smaller ones, linear between their middles and on to the border."""
    rows, cols = values.shape
    enlarged = _resized(_extended(_extended(values).T).T, factor)
    top, left = (enlarged.shape[0] - rows * factor) // 2, (enlarged.shape[1] - cols * factor) // 2
    return enlarged[top : top + rows * factor, left : left + cols * factor]


def _resized(values: Values, factor: int) -> Values:
    """The same, but level from the outermost middles on."""
    size = (values.shape[1] * factor, values.shape[0] * factor)
    resized: Any = cv2.resize(values, size, interpolation=cv2.INTER_LINEAR)
    return resized  # type: ignore[no-any-return]
