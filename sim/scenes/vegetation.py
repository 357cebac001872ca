"""Trees and bushes."""

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
import numpy.typing as npt
from pydantic import model_validator

from voxdepth.types import FloatArray

from ..bodies import Body, Cylinder, Mesh, Surface
from ..model import Model
from .plot import WAY_HEADROOM_M, Range

GRASS = Surface(albedo=0.42, pattern="grass")
"""The ground that things grow on."""

SUNK_M = 0.3
"""How deep trunks stand in the ground."""
LOBES = 14
"""Directions in which a blob bulges."""
TREE_FINENESS = 4
BUSH_FINENESS = 3


@dataclass(frozen=True, kw_only=True)
class TreeSize:
    """Measures of one tree."""

    trunk_radius_m: float
    height_m: float
    crown_start_m: float
    """Height at which the crown begins."""
    crown_radius_m: float

    @property
    def reach_m(self) -> float:
        """How far the tree comes towards a way that passes its trunk."""
        return self.trunk_radius_m if self.crown_start_m > WAY_HEADROOM_M else self.crown_radius_m


class TreeRanges(Model):
    """Ranges that the measures of trees are drawn from."""

    trunk_radius_m: Range = (0.12, 0.35)
    height_m: Range = (8.0, 13.0)
    crown_start_m: Range = (1.8, 5.0)
    """Height at which the crown begins [m]: low crowns stand in the way of flights at 2-6 m."""
    crown_radius_m: Range = (1.1, 2.4)

    @model_validator(mode="after")
    def _check(self) -> "TreeRanges":
        if self.crown_start_m[1] >= self.height_m[0]:
            raise ValueError(
                f"crowns must start below the top of every tree, got starts up to {self.crown_start_m[1]} m "
                f"and trees from {self.height_m[0]} m on"
            )
        return self

    def draw(self, rng: np.random.Generator) -> TreeSize:
        """The measures of one tree."""
        ranges = (self.trunk_radius_m, self.height_m, self.crown_start_m, self.crown_radius_m)
        trunk_radius, height, crown_start, crown_radius = (float(rng.uniform(*bounds)) for bounds in ranges)
        return TreeSize(
            trunk_radius_m=trunk_radius, height_m=height, crown_start_m=crown_start, crown_radius_m=crown_radius
        )


def tree(rng: np.random.Generator, name: str, base_m: tuple[float, float, float], size: TreeSize) -> list[Body]:
    """Trunk and crown of a tree that stands at `base_m`; the trunk ends in the middle of the crown."""
    x, y, z = base_m
    crown_half = (size.height_m - size.crown_start_m) / 2
    crown_middle = size.crown_start_m + crown_half
    trunk = Body(
        name=f"{name}-trunk",
        kind="building",
        shape=Cylinder(size.trunk_radius_m, crown_middle + SUNK_M),
        position_m=(x, y, z + (crown_middle - SUNK_M) / 2),
        surface=Surface(albedo=float(rng.uniform(0.2, 0.4)), pattern="bark"),
    )
    crown = Body(
        name=f"{name}-crown",
        kind="building",
        shape=blob(rng, size.crown_radius_m, squash=crown_half / size.crown_radius_m, fineness=TREE_FINENESS),
        position_m=(x, y, z + crown_middle),
        surface=Surface(albedo=float(rng.uniform(0.2, 0.45)), pattern="foliage"),
    )
    return [trunk, crown]


def bush(rng: np.random.Generator, name: str, base_m: tuple[float, float, float], radius_m: float) -> Body:
    """A bush whose middle is at `base_m`: its lower half is in the ground."""
    return Body(
        name=name,
        kind="building",
        shape=blob(rng, radius_m, squash=float(rng.uniform(1.0, 2.0)), fineness=BUSH_FINENESS),
        position_m=base_m,
        surface=Surface(albedo=float(rng.uniform(0.22, 0.5)), pattern="foliage"),
    )


def blob(
    rng: np.random.Generator, radius_m: float, *, squash: float = 1.0, roughness: float = 0.5, fineness: int = 4
) -> Mesh:
    """A lump of foliage around the origin, bulging in random directions.

    Args:
        rng: Decides where it bulges.
        radius_m: Largest distance of a vertex from the origin, before squashing.
        squash: Height by width; 1 is as high as wide.
        roughness: Depth of the dents as a share of the radius, at least 0, below 1.
        fineness: Parts that each edge of an icosahedron is cut into: there are 20 triangles times its square.
    """
    directions, triangles = geodesic(fineness)
    lobes = rng.normal(size=(LOBES, 3))
    lobes /= np.linalg.norm(lobes, axis=1, keepdims=True)
    bulge = np.exp(8 * ((directions @ lobes.T).max(axis=1) - 1)) + rng.uniform(0, 0.4, len(directions))
    radii = radius_m * (1 - roughness * (1 - bulge / bulge.max()))
    return Mesh(directions * radii[:, None] * (1, 1, squash), triangles)


@lru_cache
def geodesic(fineness: int) -> tuple[FloatArray, npt.NDArray[np.uint32]]:
    """Vertices and triangles of a unit sphere: an icosahedron with each edge cut into `fineness` parts."""
    golden = (1 + 5**0.5) / 2
    corners = [np.roll((0, a, b), turn) for turn in range(3) for a in (-1.0, 1.0) for b in (-golden, golden)]
    steps = [(i, j) for i in range(fineness + 1) for j in range(fineness + 1 - i)]
    points: list[FloatArray] = []
    triangles: list[tuple[int, int, int]] = []
    for face in combinations(corners, 3):
        if any(np.linalg.norm(p - q) > 2.01 for p, q in combinations(face, 2)):
            continue
        a, b, c = face if np.linalg.det(face) > 0 else face[::-1]
        at = {step: len(points) + k for k, step in enumerate(steps)}
        points += [(fineness - i - j) * a + i * b + j * c for i, j in steps]
        triangles += [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in steps if i + j < fineness]
        triangles += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in steps if i + j < fineness - 1]
    directions = np.array(points)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _, first, merged = np.unique(directions.round(6), axis=0, return_index=True, return_inverse=True)
    return directions[first], merged.ravel()[np.array(triangles)].astype(np.uint32)
