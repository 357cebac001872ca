"""Plains: rolling ground with trees and bushes on it."""

from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from ..bodies import Body, Box, Heightfield, Scene, SceneSpec, Surface
from ..errors import SceneError
from ..seeds import Purpose, stream
from .plot import Plot, Range, spots_beside, winding_way
from .vegetation import TreeRanges, bush, tree

WAY, GROUND, TREES, BUSHES = range(4)
"""Consumers of random numbers."""
SWING_M = 5.0
RUN_OUT_M = 40.0
"""Ground before and behind the way."""
RIM_M = 25.0
"""Width of the rim where hills run out into the flat land around them."""
FAR_M = 3000.0
OCTAVES = 3
GAIN = 0.35
"""Height of an octave by that of the one before, which has twice its wavelength."""
WAVES = 6
"""Plane waves per octave."""
APART_M = 0.7


class PlainsSpec(SceneSpec):
    """Hills with vegetation that grows thinner away from the way. Flights lead along x."""

    kind: Literal["plains"] = "plains"
    length_m: float = Field(200.0, ge=150)
    """Extent along x [m]."""
    width_m: float = Field(200.0, ge=60)
    """Extent along y [m]."""
    spacing_m: float = Field(2.5, ge=0.5, le=5)
    """Distance between the heights that describe the ground [m]; less is finer and costs more triangles."""
    amplitude_m: float = Field(3.0, ge=0)
    """Half the height of the highest hill above the lowest valley [m]."""
    wavelength_m: float = Field(60.0, ge=20)
    """Distance from hill to hill [m]."""
    vegetation: float = Field(0.8, ge=0)
    """Trees and bushes per 100 m2 on average: the difficulty knob; near the way there are about four times as many."""
    tree_share: float = Field(0.4, ge=0, le=1)
    """Share of the plants that are trees."""
    tree: TreeRanges = TreeRanges(height_m=(5.0, 10.0), crown_start_m=(1.2, 2.8), crown_radius_m=(0.9, 2.2))
    bush_radius_m: Range = (0.4, 1.3)
    pattern: Literal["grass", "snow"] = "grass"
    """Looks of the ground."""
    texture: float = Field(1.0, ge=0)
    """Strength of the ground's texture; 0 is blank."""
    albedo: float = Field(0.42, gt=0, le=1)
    """Share of light that the ground gives back."""

    def build(self, seed: int) -> Scene:
        """The plains of a seed: the way begins at x = 0 and winds along x; the ground begins 40 m before it."""
        way_m = winding_way(stream(seed, Purpose.SCENE, WAY), self.length_m - 2 * RUN_OUT_M, SWING_M)
        ground = _ground(self, seed)
        plot = Plot(way_m)
        count = round(self.vegetation * self.length_m * self.width_m / 100)
        n_trees = round(count * self.tree_share)
        trees = [body for i in range(n_trees) for body in _tree(self, seed, i, plot, way_m, ground)]
        bushes = [_bush(self, seed, i, plot, way_m, ground) for i in range(count - n_trees)]
        path_m = np.column_stack([way_m[:, :2], ground_height_m(ground, way_m[:, 0], way_m[:, 1])])
        bodies = (ground, _far_land(self, ground), *trees, *bushes)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=path_m)


def ground_height_m(ground: Body, x_m: FloatArray | float, y_m: FloatArray | float) -> FloatArray:
    """Height of a heightfield, exactly: each grid cell is two triangles that share its diagonal from +x to +y.

    Args:
        ground: A body whose shape is a `Heightfield` and which has no yaw.
        x_m: In the world; beyond the grid the nearest height on its border counts.
        y_m: In the world, of the same shape.

    Raises:
        SceneError: The body is no heightfield.
    """
    field = ground.shape
    if not isinstance(field, Heightfield):
        raise SceneError(f"expected the ground to be a heightfield, got a {type(field).__name__} named {ground.name}")
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
    height: FloatArray = ground.position_m[2] + np.where(u + v < 1, lower, upper)
    return height


def _ground(spec: PlainsSpec, seed: int) -> Body:
    rng = stream(seed, Purpose.SCENE, GROUND)
    columns, rows = round(spec.length_m / spec.spacing_m) + 1, round(spec.width_m / spec.spacing_m) + 1
    x, y = np.meshgrid(np.arange(columns) * spec.spacing_m, np.arange(rows) * spec.spacing_m)
    hills = _hills(rng, x, y, spec.wavelength_m)
    to_rim_m = np.minimum(np.minimum(x, x.max() - x), np.minimum(y, y.max() - y))
    fade = np.sin(np.pi / 2 * np.clip(to_rim_m / RIM_M, 0, 1)) ** 2
    height_m = 2 * spec.amplitude_m * fade * (hills - hills.min()) / np.ptp(hills)
    return Body(
        name="ground",
        kind="ground",
        shape=Heightfield(height_m, spec.spacing_m),
        position_m=(spec.length_m / 2 - RUN_OUT_M, 0.0, 0.0),
        surface=Surface(albedo=spec.albedo, texture=spec.texture, pattern=spec.pattern),
    )


def _hills(rng: np.random.Generator, x_m: FloatArray, y_m: FloatArray, wavelength_m: float) -> FloatArray:
    """Smooth noise: octaves of plane waves in random directions."""
    total = np.zeros_like(x_m)
    for octave in range(OCTAVES):
        for heading, phase in rng.uniform(0, 2 * np.pi, (WAVES, 2)):
            along_m = x_m * np.cos(heading) + y_m * np.sin(heading)
            total += GAIN**octave * np.sin(2 * np.pi * along_m * 2**octave / wavelength_m + phase)
    return total


def _far_land(spec: PlainsSpec, ground: Body) -> Body:
    """Flat land up to the horizon, just below the rim of the hills."""
    x, y, _ = ground.position_m
    shape = Box((FAR_M, FAR_M, 1.0))
    return Body(name="far-land", kind="ground", shape=shape, position_m=(x, y, -0.6), surface=ground.surface)


def _tree(spec: PlainsSpec, seed: int, index: int, plot: Plot, way_m: FloatArray, ground: Body) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, TREES, index)
    size = spec.tree.draw(rng)
    name = f"tree-{index}"
    x, y = plot.place(name, _spots(spec, rng, way_m), reach_m=size.reach_m, apart_m=APART_M)
    return tree(rng, name, (x, y, float(ground_height_m(ground, x, y))), size)


def _bush(spec: PlainsSpec, seed: int, index: int, plot: Plot, way_m: FloatArray, ground: Body) -> Body:
    rng = stream(seed, Purpose.SCENE, BUSHES, index)
    radius_m = float(rng.uniform(*spec.bush_radius_m))
    name = f"bush-{index}"
    x, y = plot.place(name, _spots(spec, rng, way_m), reach_m=radius_m, apart_m=APART_M)
    return bush(rng, name, (x, y, float(ground_height_m(ground, x, y))), radius_m)


def _spots(spec: PlainsSpec, rng: np.random.Generator, way_m: FloatArray) -> FloatArray:
    x_m = (-RUN_OUT_M, spec.length_m - RUN_OUT_M)
    return spots_beside(rng, way_m, x_m, spec.width_m / 2 - SWING_M)
