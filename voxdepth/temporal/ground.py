"""The ground: the plane that everything stands on, and that nothing is seen through."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import Field

from ..model import Model

Vector = npt.NDArray[np.float64]
"""One number per cell, shape (N,)."""

HORIZONS = np.linspace(-1.0, 0.4, 16)
"""Where horizons are tried: rows in image heights below the middle of the image, above it below 0."""
BELOW = 0.12
"""Share of the cells below a horizon that may be farther than the ground: wrong matches, and dips."""
NEAREST_RANK = 0.98
"""Share of the cells that are farther than the nearest ones that count as such: some are wrong matches."""
DEEPEST = 5.0
"""Cells of less than the largest disparity through this are left out: ground matters, and is a plane, where it is
near."""
ROUNDS = 5
"""Of the refinement; the first ones tolerate more."""
FARTHER = 6.0
"""How much more tolerance cells farther than the ground have, by which they keep their say: they contradict it, while
nearer ones stand on it."""
LEAST_CELLS = 20
"""With fewer measured cells none is looked for; of half as many it must consist."""


class GroundConfig(Model):
    """When a plane is the ground."""

    tolerance: float = Field(0.08, gt=0)
    """Part of its disparity by which a cell may be off the plane and still be ground."""
    least_share: float = Field(0.03, ge=0)
    """Part of the cells that must be ground. More than 1 looks for no ground."""
    least_range: float = Field(1.25, ge=1)
    """How many times as near as its far end the near end of the ground must be; less may be a wall."""
    most_farther: float = Field(0.3, ge=0)
    """Most cells that are farther than the plane by twice the tolerance, through the number of those on it: nothing is
    seen through the ground."""


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Its disparity, linear in the image, as that of all planes."""

    slope_u: float
    """Change of disparity [px] per cell to the right."""
    slope_v: float
    """Change [px] per cell downward, above that to either side."""
    middle_px: float
    """Disparity in the middle of the image, below 0 where that is above the horizon."""

    def at(self, u: Vector, v: Vector) -> Vector:
        """Disparity [px] at columns and rows in cells from the middle of the image; above the horizon below 0.

        `u` and `v` have shapes that broadcast, and the outcome has the shape of both.
        """
        ground_px: Vector = self.slope_u * u + self.slope_v * v + self.middle_px
        return ground_px


def found_ground(u: Vector, v: Vector, disparity_px: Vector, rows: int, config: GroundConfig) -> Ground | None:
    """The plane with hardly anything below it and as much as possible on it; None if there is no such plane.

    Blank ground shows only where things touch it. So what is looked for is no surface, but what bounds all surfaces
    from below. The more cells a half octave of disparity has, the less each one counts: of far things there are more.

    Args:
        u: Columns of measured cells, from the middle of the image, in cells, shape (N,).
        v: Their rows, likewise, shape (N,).
        disparity_px: Their mean disparities, above 0, shape (N,).
        rows: Cells along the height of the image.
        config: See there.
    """
    if len(u) < LEAST_CELLS:
        return None
    near = disparity_px > _ranked(disparity_px, NEAREST_RANK) / DEEPEST
    u, v, disparity_px = u[near], v[near], disparity_px[near]
    plane = _refined(_level_plane(v, disparity_px, rows, config.tolerance), u, v, disparity_px, config.tolerance)
    ground_px = plane[0] * u + plane[1] * v + plane[2]
    off = disparity_px / np.maximum(ground_px, 1e-6) - 1
    on_it = (np.abs(off) < config.tolerance) & (ground_px > 0)
    farther = (off < -2 * config.tolerance) & (ground_px > 0)
    n = np.count_nonzero(on_it)
    if plane[1] <= abs(plane[0]) or n < max(LEAST_CELLS / 2, config.least_share * len(u)):
        return None
    if np.count_nonzero(farther) > config.most_farther * n:
        return None
    if _ranked(ground_px[on_it], 0.9) < config.least_range * _ranked(ground_px[on_it], 0.1):
        return None
    return Ground(slope_u=float(plane[0]), slope_v=float(plane[1]), middle_px=float(plane[2]))


def _ranked(values: Vector, share: float) -> float:
    """The value that this share of all is below."""
    return float(np.sort(values)[int(share * (len(values) - 1))])


def _level_plane(v: Vector, disparity_px: Vector, rows: int, tolerance: float) -> Vector:
    """The best of some planes without a slope to the side: slopes to the right and down, and the middle, shape (3,)."""
    octave = np.floor(2 * np.log2(disparity_px)).astype(np.intp)
    octave -= octave.min()
    say = 1 / np.sqrt(np.bincount(octave)[octave])
    rows_below = v - rows * HORIZONS[:, None]
    with np.errstate(divide="ignore"):
        slope = np.where(rows_below > 0.5, disparity_px / np.maximum(rows_below, 0.5), np.inf)
    rank = (BELOW * np.count_nonzero(rows_below > 0.5, axis=1)).astype(np.intp) + 1
    lowest = np.sort(slope, axis=1)[np.arange(len(rank)), np.minimum(rank, len(v) - 1)]
    lowest = np.where(np.isfinite(lowest), lowest, 0)
    over = slope - lowest[:, None] * (1 - 1.5 * tolerance)
    on_it = (over > 0) & (over < lowest[:, None] * 3 * tolerance)
    best = np.argmax((on_it.astype(np.float64) - (over <= 0)) @ say)
    return np.array([0.0, lowest[best], -lowest[best] * rows * HORIZONS[best]])


def _refined(plane: Vector, u: Vector, v: Vector, disparity_px: Vector, tolerance: float) -> Vector:
    """Reweighted least squares of relative errors: what is nearer soon counts nothing, what is farther still does.

    Planes are slopes to the right and down, and the middle, shape (3,).
    """
    points = np.stack([u, v, np.ones_like(u)], 1)
    for turn in range(ROUNDS):
        ground_px = points @ plane
        below_horizon = ground_px > 0
        ground_px = np.maximum(ground_px, 1e-6)
        off = (disparity_px / ground_px - 1) / (tolerance * max(1, 3 - turn))
        off[off < 0] /= FARTHER
        weighted = points * (below_horizon / np.square(1 + off * off) / ground_px)[:, None]
        normal = points.T @ weighted
        normal += np.eye(3) * (1e-9 * np.trace(normal) + 1e-12)
        plane = np.asarray(np.linalg.solve(normal, disparity_px @ weighted), np.float64)
    return plane
