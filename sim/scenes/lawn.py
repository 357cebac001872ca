"""A lawn: a park at human scale, with bushes, trees, a hedge, a wall and benches along a way."""

from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray

from ..bodies import Body, Box, Scene, SceneSpec, Surface
from ..seeds import Purpose, stream
from .plot import Plot, Range, flat_ground, spots_beside, winding_way
from .vegetation import GRASS, TreeRanges, bush, tree

WAY, HEDGE, WALL, TREES, BENCHES, BUSHES = range(6)
"""Consumers of random numbers."""
SWING_M = 2.5
PIECE_M = 2.0
"""Length of the pieces of a hedge or wall, which follow the curves of the way."""
TRUNK_APART_M = 0.8
BENCH_REACH_M = 1.1


class LawnSpec(SceneSpec):
    """Things of human size on both sides of a way that leads along x."""

    kind: Literal["lawn"] = "lawn"
    length_m: float = Field(100.0, ge=70)
    """Length of the way along x [m]."""
    width_m: float = Field(30.0, ge=12)
    """Width of the strip around the way where things stand [m]."""
    bushes: int = Field(80, ge=0)
    trees: int = Field(30, ge=0)
    benches: int = Field(10, ge=0)
    """Benches and boxes."""
    hedge_m: float = Field(24.0, ge=0)
    """Length of a hedge on the left of the way's first half [m]."""
    wall_m: float = Field(18.0, ge=0)
    """Length of a low wall on the right of the way's second half [m]."""
    bush_radius_m: Range = (0.4, 1.2)
    tree: TreeRanges = TreeRanges(height_m=(5.0, 10.0), crown_start_m=(1.7, 2.8), crown_radius_m=(1.2, 2.4))

    @model_validator(mode="after")
    def _check(self) -> "LawnSpec":
        if max(self.hedge_m, self.wall_m) > self.length_m / 2:
            raise ValueError(
                f"hedge and wall must each be at most half as long as the way, {self.length_m / 2} m, "
                f"got {self.hedge_m} m and {self.wall_m} m"
            )
        return self

    def build(self, seed: int) -> Scene:
        """The lawn of a seed: its way begins at x = 0 near y = 0."""
        way_m = winding_way(stream(seed, Purpose.SCENE, WAY), self.length_m, SWING_M)
        plot = Plot(way_m)
        things = [
            *_hedge(self, seed, plot, way_m),
            *_wall(self, seed, plot, way_m),
            *(body for i in range(self.trees) for body in _tree(self, seed, i, plot, way_m)),
            *(_bench(self, seed, i, plot, way_m) for i in range(self.benches)),
            *(_bush(self, seed, i, plot, way_m) for i in range(self.bushes)),
        ]
        bodies = (flat_ground(self.length_m / 2, GRASS), *things)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=way_m)


def _hedge(spec: LawnSpec, seed: int, plot: Plot, way_m: FloatArray) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, HEDGE)
    start_m = float(rng.uniform(0, spec.length_m / 2 - spec.hedge_m))
    surface = Surface(albedo=float(rng.uniform(0.25, 0.4)), pattern="foliage")
    line_m = _line(way_m, start_m, spec.hedge_m, float(rng.uniform(3.5, 5.0)))
    return _row("hedge", line_m, 0.8, float(rng.uniform(1.0, 1.6)), surface, plot)


def _wall(spec: LawnSpec, seed: int, plot: Plot, way_m: FloatArray) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, WALL)
    start_m = float(rng.uniform(spec.length_m / 2, spec.length_m - spec.wall_m))
    surface = Surface(albedo=float(rng.uniform(0.4, 0.7)))
    line_m = _line(way_m, start_m, spec.wall_m, -float(rng.uniform(3.0, 5.0)))
    return _row("wall", line_m, 0.35, float(rng.uniform(0.7, 1.2)), surface, plot)


def _line(way_m: FloatArray, start_m: float, length_m: float, offset_m: float) -> FloatArray:
    """Corners (x, y) of a line beside the way, shape (n, 2); the offset is to the left."""
    x = np.linspace(start_m, start_m + length_m, int(np.ceil(length_m / PIECE_M)) + 1)
    return np.stack([x, np.interp(x, way_m[:, 0], way_m[:, 1]) + offset_m], axis=1)


def _row(name: str, line_m: FloatArray, depth_m: float, height_m: float, surface: Surface, plot: Plot) -> list[Body]:
    """A box between each corner of a line and the next."""
    bodies = []
    for i, (start, end) in enumerate(pairwise(line_m)):
        (x, y), (dx, dy) = (start + end) / 2, end - start
        length_m = float(np.hypot(dx, dy))
        plot.take(float(x), float(y), length_m / 2)
        bodies.append(
            Body(
                name=f"{name}-{i}",
                kind="building",
                shape=Box((length_m, depth_m, height_m)),
                position_m=(float(x), float(y), height_m / 2),
                yaw_rad=float(np.arctan2(dy, dx)),
                surface=surface,
            )
        )
    return bodies


def _tree(spec: LawnSpec, seed: int, index: int, plot: Plot, way_m: FloatArray) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, TREES, index)
    size = spec.tree.draw(rng)
    name = f"tree-{index}"
    x, y = plot.place(name, _spots(spec, rng, way_m), reach_m=size.reach_m, apart_m=TRUNK_APART_M)
    return tree(rng, name, (x, y, 0.0), size)


def _bench(spec: LawnSpec, seed: int, index: int, plot: Plot, way_m: FloatArray) -> Body:
    rng = stream(seed, Purpose.SCENE, BENCHES, index)
    size = rng.uniform((0.6, 0.4, 0.4), (1.9, 0.7, 0.9))
    name = f"bench-{index}"
    x, y = plot.place(name, _spots(spec, rng, way_m), reach_m=BENCH_REACH_M, apart_m=BENCH_REACH_M)
    return Body(
        name=name,
        kind="building",
        shape=Box((float(size[0]), float(size[1]), float(size[2]))),
        position_m=(x, y, float(size[2] / 2)),
        yaw_rad=float(rng.uniform(-np.pi, np.pi)),
        surface=Surface(albedo=float(rng.uniform(0.3, 0.7))),
    )


def _bush(spec: LawnSpec, seed: int, index: int, plot: Plot, way_m: FloatArray) -> Body:
    rng = stream(seed, Purpose.SCENE, BUSHES, index)
    radius_m = float(rng.uniform(*spec.bush_radius_m))
    name = f"bush-{index}"
    x, y = plot.place(name, _spots(spec, rng, way_m), reach_m=radius_m, apart_m=0.7 * radius_m)
    return bush(rng, name, (x, y, 0.0), radius_m)


def _spots(spec: LawnSpec, rng: np.random.Generator, way_m: FloatArray) -> FloatArray:
    return spots_beside(rng, way_m, (0, spec.length_m), spec.width_m / 2)
