"""A forest of trees with low crowns on flat ground."""

from typing import Literal

from pydantic import Field

from ..bodies import Scene, SceneSpec
from ..seeds import Purpose, stream
from .layout import TRIES, Layout, flat_ground, winding_path
from .vegetation import GRASS, Garden, TreeRanges

PATH, TREES, BUSHES = range(3)
"""Keys of random streams."""
SWING_M = 3.0
TREE = TreeRanges()
BUSH_RADIUS_M, BUSH_APART_M = (0.4, 1.0), 0.3


class ForestSpec(SceneSpec):
    """Trees at random positions with a minimum distance, and bushes. Flights lead along x."""

    kind: Literal["forest"] = "forest"
    length_m: float = Field(default=100.0, ge=70)
    """Extent along x [m]."""
    width_m: float = Field(default=40.0, ge=20)
    """Extent along y [m]."""
    density: float = Field(default=4.0, gt=0)
    """Trees per 100 m2 of ground; a denser forest is harder."""
    spacing_m: float = Field(default=2.0, gt=0)
    """Minimum distance between trunks, axis to axis [m]. A larger distance leaves room for fewer trees."""
    bushes: int = Field(default=60, ge=0, le=5_000)

    def build(self, seed: int) -> Scene:
        """Return the forest of a seed: it begins at x = 0 and is centred on y = 0. A path winds through it along x."""
        path_m = winding_path(stream(seed, Purpose.SCENE, PATH), self.length_m, SWING_M)
        low_m, high_m = (0, -self.width_m / 2), (self.length_m, self.width_m / 2)
        garden = Garden(seed=seed, layout=Layout(path_m), candidates=lambda rng: rng.uniform(low_m, high_m, (TRIES, 2)))
        n_trees = round(self.density * self.length_m * self.width_m / 100)
        trees = garden.trees(n_trees, TREES, TREE, apart_m=self.spacing_m / 2)
        bushes = garden.bushes(self.bushes, BUSHES, BUSH_RADIUS_M, apart_m=lambda radius: BUSH_APART_M)
        bodies = (flat_ground(self.length_m / 2, GRASS), *trees, *bushes)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=path_m)
