"""Hilly ground with trees and bushes."""

import math
from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.arithmetic import sin
from voxdepth.types import FloatArray

from ..bodies import Body, Box, Heightfield, Scene, SceneSpec, Surface
from ..seeds import Purpose, stream
from .layout import Layout, positions_beside, winding_path
from .vegetation import Garden, TreeRanges

PATH, GROUND, TREES, BUSHES = range(4)
"""Keys of random streams."""
SWING_M = 5.0
RUN_OUT_M = 40.0
"""Length of the ground before and behind the path."""
RIM_M = 25.0
"""Width of the rim in which the hills level out into the flat land around them."""
FAR_M = 3000.0
SPACING_M = 2.5
"""Grid spacing of the ground."""
WAVELENGTH_M = 60.0
"""Wavelength of the hills."""
OCTAVES = 3
GAIN = 0.35
"""Ratio of the heights of successive octaves, whose wavelengths halve."""
WAVES = 6
"""Plane waves per octave."""
TREE_SHARE = 0.4
"""Share of the plants that are trees."""
TREE = TreeRanges(height_m=(5.0, 10.0), crown_start_m=(1.2, 2.8), crown_radius_m=(0.9, 2.2))
BUSH_RADIUS_M = (0.4, 1.3)
APART_M = 0.7


class PlainsSpec(SceneSpec):
    """Hills with vegetation that is densest near the path. Flights lead along x."""

    kind: Literal["plains"] = "plains"
    length_m: float = Field(default=200.0, ge=150)
    """Extent along x [m]."""
    width_m: float = Field(default=200.0, ge=60)
    """Extent along y [m]."""
    amplitude_m: float = Field(default=3.0, ge=0)
    """Half the height of the highest hill above the lowest valley [m]."""
    vegetation: float = Field(default=0.8, ge=0)
    """Mean number of trees and bushes per 100 m2; more are harder. Near the path there are about four times as many."""
    pattern: Literal["grass", "snow"] = "grass"
    """Pattern of the ground."""
    texture: float = Field(default=1.0, ge=0)
    """Strength of the ground's texture; 0 is textureless."""
    albedo: float = Field(default=0.42, gt=0, le=1)
    """Share of the light that the ground reflects."""

    def build(self, seed: int) -> Scene:
        """Return the plains of a seed: the path begins at x = 0 and winds along x; the ground begins 40 m before it."""
        path_m = winding_path(stream(seed, Purpose.SCENE, PATH), self.length_m - 2 * RUN_OUT_M, SWING_M)
        ground = _ground(self, seed)
        x_m, side_m = (-RUN_OUT_M, self.length_m - RUN_OUT_M), self.width_m / 2 - SWING_M
        garden = Garden(
            seed=seed,
            layout=Layout(path_m),
            candidates=lambda rng: positions_beside(rng, path_m, x_m, side_m),
            height_m=lambda x, y: float(ground_height_m(ground, x, y)),
        )
        n_plants = round(self.vegetation * self.length_m * self.width_m / 100)
        n_trees = round(n_plants * TREE_SHARE)
        trees = garden.trees(n_trees, TREES, TREE, apart_m=APART_M)
        bushes = garden.bushes(n_plants - n_trees, BUSHES, BUSH_RADIUS_M, apart_m=lambda radius: APART_M)
        on_ground_m = np.column_stack([path_m[:, :2], ground_height_m(ground, path_m[:, 0], path_m[:, 1])])
        # Flat land reaches up to the horizon, slightly below the rim of the hills.
        (x, y, _), flat = ground.position_m, Box((FAR_M, FAR_M, 1.0))
        far_land = Body(name="far-land", kind="ground", shape=flat, position_m=(x, y, -0.6), surface=ground.surface)
        bodies = (ground, far_land, *trees, *bushes)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=on_ground_m)


def ground_height_m(ground: Body, x_m: FloatArray | float, y_m: FloatArray | float) -> FloatArray:
    """Return the exact height of a heightfield, whose cells are two triangles that share the diagonal from +x to +y.

    The ground has no yaw, and both coordinates have the same shape. Outside of the grid, the nearest height on its
    border counts.
    """
    field = ground.shape
    assert isinstance(field, Heightfield)
    rows, columns = field.height_m.shape
    column = (np.asarray(x_m) - ground.position_m[0]) / field.spacing_m + (columns - 1) / 2
    row = (np.asarray(y_m) - ground.position_m[1]) / field.spacing_m + (rows - 1) / 2
    column, row = np.clip(column, 0, columns - 1), np.clip(row, 0, rows - 1)
    i, j = np.minimum(row.astype(int), rows - 2), np.minimum(column.astype(int), columns - 2)
    u, v = column - j, row - i
    corner, right = field.height_m[i, j], field.height_m[i, j + 1]
    up, across = field.height_m[i + 1, j], field.height_m[i + 1, j + 1]
    lower = corner + u * (right - corner) + v * (up - corner)
    upper = across + (1 - u) * (up - across) + (1 - v) * (right - across)
    return np.asarray(ground.position_m[2] + np.where(u + v < 1, lower, upper))


def _ground(spec: PlainsSpec, seed: int) -> Body:
    rng = stream(seed, Purpose.SCENE, GROUND)
    columns, rows = round(spec.length_m / SPACING_M) + 1, round(spec.width_m / SPACING_M) + 1
    x, y = np.meshgrid(np.arange(columns) * SPACING_M, np.arange(rows) * SPACING_M)
    hills = _hills(rng, x, y)
    to_rim_m = np.minimum(np.minimum(x, x.max() - x), np.minimum(y, y.max() - y))
    fade = sin(np.pi / 2 * np.clip(to_rim_m / RIM_M, 0, 1)) ** 2
    height_m = 2 * spec.amplitude_m * fade * (hills - hills.min()) / np.ptp(hills)
    surface = Surface(albedo=spec.albedo, texture=spec.texture, pattern=spec.pattern)
    shape, middle_m = Heightfield(height_m, SPACING_M), (spec.length_m / 2 - RUN_OUT_M, 0.0, 0.0)
    return Body(name="ground", kind="ground", shape=shape, position_m=middle_m, surface=surface)


def _hills(rng: np.random.Generator, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """Return smooth noise: octaves of plane waves in random directions."""
    total = np.zeros_like(x_m)
    for octave in range(OCTAVES):
        for heading, phase in rng.uniform(0, 2 * np.pi, (WAVES, 2)):
            along_m = x_m * math.cos(heading) + y_m * math.sin(heading)
            total += GAIN**octave * sin(2 * np.pi * along_m * 2**octave / WAVELENGTH_M + phase)
    return total
