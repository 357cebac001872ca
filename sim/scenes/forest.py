"""A forest: trunks and low crowns on flat ground."""

from typing import Literal

from pydantic import Field

from ..bodies import Body, Scene, SceneSpec
from ..seeds import Purpose, stream
from .plot import TRIES, Plot, Range, flat_ground, winding_way
from .vegetation import GRASS, TreeRanges, bush, tree

WAY, TREES, BUSHES = range(3)
"""Consumers of random numbers."""
SWING_M = 3.0
BUSH_APART_M = 0.3


class ForestSpec(SceneSpec):
    """Trees at random places with a least distance, and undergrowth. Flights lead along x."""

    kind: Literal["forest"] = "forest"
    length_m: float = Field(100.0, ge=70)
    """Extent along x [m]."""
    width_m: float = Field(40.0, ge=20)
    """Extent along y [m]."""
    density: float = Field(4.0, gt=0)
    """Trees per 100 m2 of ground: the difficulty knob; more is harder."""
    spacing_m: float = Field(2.0, gt=0)
    """Least distance between trunks, axis to axis [m]. The larger it is, the fewer trees find room."""
    tree: TreeRanges = TreeRanges()
    bushes: int = Field(60, ge=0)
    bush_radius_m: Range = (0.4, 1.0)

    def build(self, seed: int) -> Scene:
        """The forest of a seed: it begins at x = 0 and is centred on y = 0. A way winds through it along x."""
        way_m = winding_way(stream(seed, Purpose.SCENE, WAY), self.length_m, SWING_M)
        plot = Plot(way_m)
        count = round(self.density * self.length_m * self.width_m / 100)
        trees = [body for i in range(count) for body in _tree(self, seed, i, plot)]
        bushes = [_bush(self, seed, i, plot) for i in range(self.bushes)]
        bodies = (flat_ground(self.length_m / 2, GRASS), *trees, *bushes)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=way_m)


def _tree(spec: ForestSpec, seed: int, index: int, plot: Plot) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, TREES, index)
    size = spec.tree.draw(rng)
    name = f"tree-{index}"
    spots_m = rng.uniform((0, -spec.width_m / 2), (spec.length_m, spec.width_m / 2), (TRIES, 2))
    x, y = plot.place(name, spots_m, reach_m=size.reach_m, apart_m=spec.spacing_m / 2)
    return tree(rng, name, (x, y, 0.0), size)


def _bush(spec: ForestSpec, seed: int, index: int, plot: Plot) -> Body:
    rng = stream(seed, Purpose.SCENE, BUSHES, index)
    radius_m = float(rng.uniform(*spec.bush_radius_m))
    name = f"bush-{index}"
    spots_m = rng.uniform((0, -spec.width_m / 2), (spec.length_m, spec.width_m / 2), (TRIES, 2))
    x, y = plot.place(name, spots_m, reach_m=radius_m, apart_m=BUSH_APART_M)
    return bush(rng, name, (x, y, 0.0), radius_m)
