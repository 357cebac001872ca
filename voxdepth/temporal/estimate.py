"""What holes are filled with, cell by cell, and how likely that is of the right surface."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Grid = npt.NDArray[np.float64]
"""One number per cell, shape (rows, cols), or several, shape (N, rows, cols)."""


@dataclass(frozen=True, kw_only=True)
class Chances:
    """Chance of what was filled to be of the right surface, by what it was filled with, 0..1."""

    finest_plane: float
    """A plane through what was measured around a cell of the smallest size."""
    coarser: float
    """Part of it that is left for every doubling of that size: less is known of a hole far from its rim."""
    shadow: float
    """The background, in an occlusion shadow."""
    ground: float
    """The ground, or not farther than it."""
    bare: float
    """What stands on the ground, above its foot."""
    behind: float
    """The same, where other things are before it."""

    def plane(self, level: int) -> float:
        """Of planes around cells of `2**level` times the smallest size."""
        return self.finest_plane * self.coarser**level


CHANCES = Chances(finest_plane=0.5, coarser=0.43, shadow=0.56, ground=0.87, bare=0.9, behind=0.43)
"""Means of two fits by least squares: to the twelve rendered sequences of seed 101, and to what eight drones saw in two
flights through the scenario `city`, of seeds 1008 and 1010. They agree but for what is behind, which is mostly the
blank snow of one sequence: the finest planes 0.48 and 0.54, the next ones 0.24 and 0.20, shadows 0.56 and 0.56, ground
0.85 and 0.89, bare 0.91 and 1, behind 0.75 and 0.11. No guess shall be surer than a good memory: bare is 0.9."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What cells of one size are filled with."""

    value_px: Grid
    """Disparity in their middles."""
    chance: Grid
    """Chance that it is of the right surface, 0..1."""

    def replaced(self, value_px: Grid, chance: float, where: npt.NDArray[np.bool_]) -> "Estimate":
        """The same with other values, of one chance, in some cells."""
        return Estimate(value_px=np.where(where, value_px, self.value_px), chance=np.where(where, chance, self.chance))
