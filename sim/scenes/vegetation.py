"""Trees and bushes, and how they are planted."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import exp, length, matmul
from voxdepth.types import FloatArray

from ..bodies import Body, Cylinder, Mesh, Surface
from ..seeds import Purpose, stream
from .layout import PATH_HEADROOM_M, Layout

GRASS = Surface(albedo=0.42, pattern="grass")
"""Surface of the ground."""

SUNK_M = 0.3
"""Depth of trunks below the ground."""
LOBES = 14
"""Number of random directions in which a blob bulges."""
TREE_FINENESS = 4
BUSH_FINENESS = 3


@dataclass(frozen=True)
class TreeSize:
    """Dimensions of one tree."""

    trunk_radius_m: float
    height_m: float
    crown_start_m: float
    """Height at which the crown begins."""
    crown_radius_m: float

    @property
    def reach_m(self) -> float:
        """Extent of the tree towards a path that passes its trunk."""
        return self.trunk_radius_m if self.crown_start_m > PATH_HEADROOM_M else self.crown_radius_m


class TreeRanges(NamedTuple):
    """Ranges from which the dimensions of trees are drawn [m]."""

    trunk_radius_m: tuple[float, float] = (0.12, 0.35)
    height_m: tuple[float, float] = (8.0, 13.0)
    crown_start_m: tuple[float, float] = (1.8, 5.0)
    """Height at which the crown begins; low crowns obstruct flights at 2-6 m."""
    crown_radius_m: tuple[float, float] = (1.1, 2.4)

    def draw(self, rng: np.random.Generator) -> TreeSize:
        """Draw the dimensions of one tree."""
        return TreeSize(*(rng.uniform(*bounds) for bounds in self))


Candidates = Callable[[np.random.Generator], FloatArray]
"""Draws positions (x, y) for one plant, shape (n, 2)."""


@dataclass(frozen=True, kw_only=True)
class Garden:
    """Plants trees and bushes. Every plant has its own random stream, keyed by its kind and its index.

    A plant that finds no free position raises a `SceneError`.
    """

    seed: int
    layout: Layout
    candidates: Candidates
    height_m: Callable[[float, float], float] = lambda x, y: 0.0
    """Height of the ground at a position (x, y)."""

    def trees(self, count: int, key: int, ranges: TreeRanges, *, apart_m: float) -> list[Body]:
        """Plant trees, and return their trunks and crowns in turn.

        Args:
            count: Number of trees.
            key: Key of their random streams, another one for each kind of plant in a scene.
            ranges: Ranges of their dimensions.
            apart_m: Radius of the circle around each trunk that overlaps with no circle of another plant.
        """
        bodies = []
        for index in range(count):
            rng, name = stream(self.seed, Purpose.SCENE, key, index), f"tree-{index}"
            size = ranges.draw(rng)
            x, y = self.layout.place(name, self.candidates(rng), reach_m=size.reach_m, apart_m=apart_m)
            bodies += tree(rng, name, (x, y, self.height_m(x, y)), size)
        return bodies

    def bushes(
        self, count: int, key: int, radius_m: tuple[float, float], *, apart_m: Callable[[float], float]
    ) -> list[Body]:
        """Plant bushes.

        Args:
            count: Number of bushes.
            key: Key of their random streams, another one for each kind of plant in a scene.
            radius_m: Least and largest radius.
            apart_m: Gives, by the radius of a bush, the radius of the circle around it that overlaps with no circle of
                another plant.
        """
        bodies = []
        for index in range(count):
            rng, name = stream(self.seed, Purpose.SCENE, key, index), f"bush-{index}"
            radius = rng.uniform(*radius_m)
            x, y = self.layout.place(name, self.candidates(rng), reach_m=radius, apart_m=apart_m(radius))
            bodies.append(bush(rng, name, (x, y, self.height_m(x, y)), radius))
        return bodies


def tree(rng: np.random.Generator, name: str, base_m: tuple[float, float, float], size: TreeSize) -> list[Body]:
    """Return trunk and crown of a tree; the trunk ends in the middle of the crown.

    Args:
        rng: Source of randomness.
        name: Name of the tree, from which those of its parts are made.
        base_m: Where it stands on the ground, world frame.
        size: Its dimensions.
    """
    x, y, z = base_m
    crown_half = (size.height_m - size.crown_start_m) / 2
    crown_middle = size.crown_start_m + crown_half
    bark = Surface(albedo=rng.uniform(0.2, 0.4), pattern="bark")
    trunk = Cylinder(size.trunk_radius_m, crown_middle + SUNK_M)
    crown = blob(rng, size.crown_radius_m, squash=crown_half / size.crown_radius_m, fineness=TREE_FINENESS)
    leaves = Surface(albedo=rng.uniform(0.2, 0.45), pattern="foliage")
    trunk_at_m = (x, y, z + (crown_middle - SUNK_M) / 2)
    return [
        Body(name=f"{name}-trunk", shape=trunk, position_m=trunk_at_m, surface=bark),
        Body(name=f"{name}-crown", shape=crown, position_m=(x, y, z + crown_middle), surface=leaves),
    ]


def bush(rng: np.random.Generator, name: str, base_m: tuple[float, float, float], radius_m: float) -> Body:
    """Return a bush whose lower half is in the ground.

    Args:
        rng: Source of randomness.
        name: Its name in the scene.
        base_m: Its centre, on the ground, world frame.
        radius_m: Its largest horizontal extent from the centre.
    """
    shape = blob(rng, radius_m, squash=rng.uniform(1.0, 2.0), fineness=BUSH_FINENESS)
    leaves = Surface(albedo=rng.uniform(0.22, 0.5), pattern="foliage")
    return Body(name=name, shape=shape, position_m=base_m, surface=leaves)


def blob(
    rng: np.random.Generator, radius_m: float, *, squash: float = 1.0, roughness: float = 0.5, fineness: int = 4
) -> Mesh:
    """Return a closed surface around the origin that bulges in random directions, as foliage does.

    Args:
        rng: Source of randomness.
        radius_m: Distance of the farthest vertex from the origin, before `squash`.
        squash: Factor of the heights.
        roughness: Depth of the deepest dents as a share of the radius, at least 0 and below 1.
        fineness: That of `geodesic`.
    """
    directions, triangles = geodesic(fineness)
    lobes = rng.normal(size=(LOBES, 3))
    lobes /= np.linalg.norm(lobes, axis=1, keepdims=True)
    bulge = exp(8 * (matmul(directions, lobes.T).max(axis=1) - 1)) + rng.uniform(0, 0.4, len(directions))
    radii = radius_m * (1 - roughness * (1 - bulge / bulge.max()))
    return Mesh(directions * radii[:, None] * (1, 1, squash), triangles)


@lru_cache
def geodesic(fineness: int) -> tuple[FloatArray, npt.NDArray[np.uint32]]:
    """Return the vertices and triangles of a unit sphere: an icosahedron with edges in `fineness` parts.

    There are `20 fineness**2` triangles.
    """
    golden = (1 + 5**0.5) / 2
    corners = [np.roll((0, a, b), turn) for turn in range(3) for a in (-1.0, 1.0) for b in (-golden, golden)]
    steps = [(i, j) for i in range(fineness + 1) for j in range(fineness + 1 - i)]
    points: list[FloatArray] = []
    triangles: list[tuple[int, int, int]] = []
    for face in combinations(corners, 3):
        # The edges of the icosahedron have the length 2; other triples of its corners are no face.
        if any(length(p - q) > 2.01 for p, q in combinations(face, 2)):
            continue
        # In the order in which the triangle is counter-clockwise when seen from outside.
        a, b, c = face if np.linalg.det(face) > 0 else face[::-1]
        at = {step: len(points) + k for k, step in enumerate(steps)}
        points += [(fineness - i - j) * a + i * b + j * c for i, j in steps]
        triangles += [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in steps if i + j < fineness]
        triangles += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in steps if i + j < fineness - 1]
    directions = np.array(points)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    _, first, merged = np.unique(directions.round(6), axis=0, return_index=True, return_inverse=True)
    return directions[first], merged.ravel()[np.array(triangles)].astype(np.uint32)
