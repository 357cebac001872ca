"""A park at human scale, with bushes, trees, a hedge, a wall and benches along a path."""

import math
from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from ..bodies import Body, Box, Scene, SceneSpec, Surface, standing_body
from ..seeds import Purpose, stream
from .layout import Layout, flat_ground, positions_beside, winding_path
from .vegetation import GRASS, Candidates, Garden, TreeRanges

PATH, HEDGE, WALL, TREES, BENCHES, BUSHES = range(6)
"""Keys of random streams."""
SWING_M = 2.5
PIECE_M = 2.0
"""Length of the pieces of a hedge or wall, which follow the curves of the path."""
TREE = TreeRanges(height_m=(5.0, 10.0), crown_start_m=(1.7, 2.8), crown_radius_m=(1.2, 2.4))
TRUNK_APART_M = 0.8
BUSH_RADIUS_M = (0.4, 1.2)
HEDGE_M, WALL_M = 24.0, 18.0
"""Lengths of a hedge on the left of the first half of the path, and of a low wall on the right of the second one."""
BENCH_REACH_M = 1.1


class LawnSpec(SceneSpec):
    """A lawn with obstacles of human size on both sides of a path, which leads along x."""

    kind: Literal["lawn"] = "lawn"
    length_m: float = Field(default=100.0, ge=70)
    """Length of the path along x [m]."""
    width_m: float = Field(default=30.0, ge=12)
    """Width of the strip around the path that has obstacles [m]."""
    bushes: int = Field(default=80, ge=0, le=5_000)
    trees: int = Field(default=30, ge=0, le=5_000)
    benches: int = Field(default=10, ge=0, le=5_000)
    """Benches and boxes."""

    def build(self, seed: int) -> Scene:
        """Return the lawn of a seed: its path begins at x = 0 near y = 0."""
        path_m = winding_path(stream(seed, Purpose.SCENE, PATH), self.length_m, SWING_M)
        layout = Layout(path_m)

        def candidates(rng: np.random.Generator) -> FloatArray:
            return positions_beside(rng, path_m, (0, self.length_m), self.width_m / 2)

        garden = Garden(seed=seed, layout=layout, candidates=candidates)
        bodies = (
            flat_ground(self.length_m / 2, GRASS),
            *_hedge(self, seed, layout, path_m),
            *_wall(self, seed, layout, path_m),
            *garden.trees(self.trees, TREES, TREE, apart_m=TRUNK_APART_M),
            *(_bench(seed, i, layout, candidates) for i in range(self.benches)),
            *garden.bushes(self.bushes, BUSHES, BUSH_RADIUS_M, apart_m=lambda radius: 0.7 * radius),
        )
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=path_m)


def _hedge(spec: LawnSpec, seed: int, layout: Layout, path_m: FloatArray) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, HEDGE)
    start_m = rng.uniform(0, spec.length_m / 2 - HEDGE_M)
    surface = Surface(albedo=rng.uniform(0.25, 0.4), pattern="foliage")
    line_m = _line(path_m, start_m, HEDGE_M, rng.uniform(3.5, 5.0))
    return _row("hedge", line_m, 0.8, rng.uniform(1.0, 1.6), surface, layout)


def _wall(spec: LawnSpec, seed: int, layout: Layout, path_m: FloatArray) -> list[Body]:
    rng = stream(seed, Purpose.SCENE, WALL)
    start_m = rng.uniform(spec.length_m / 2, spec.length_m - WALL_M)
    surface = Surface(albedo=rng.uniform(0.4, 0.7))
    line_m = _line(path_m, start_m, WALL_M, -rng.uniform(3.0, 5.0))
    return _row("wall", line_m, 0.35, rng.uniform(0.7, 1.2), surface, layout)


def _line(path_m: FloatArray, start_m: float, length_m: float, offset_m: float) -> FloatArray:
    """Return corners (x, y) of a line beside the path, shape (n, 2); a positive offset is to the left."""
    x = np.linspace(start_m, start_m + length_m, int(np.ceil(length_m / PIECE_M)) + 1)
    return np.stack([x, np.interp(x, path_m[:, 0], path_m[:, 1]) + offset_m], axis=1)


def _row(
    name: str, line_m: FloatArray, depth_m: float, height_m: float, surface: Surface, layout: Layout
) -> list[Body]:
    """Return boxes between successive corners of a line."""
    bodies = []
    for i, (start, end) in enumerate(pairwise(line_m)):
        x, y = ((start + end) / 2).tolist()
        dx, dy = end - start
        length_m, yaw_rad = math.hypot(dx, dy), math.atan2(dy, dx)
        layout.reserve(x, y, length_m / 2)
        shape = Box((length_m, depth_m, height_m))
        bodies.append(standing_body(f"{name}-{i}", shape, x, y, surface, yaw_rad=yaw_rad))
    return bodies


def _bench(seed: int, index: int, layout: Layout, candidates: Candidates) -> Body:
    rng = stream(seed, Purpose.SCENE, BENCHES, index)
    shape = Box(tuple(rng.uniform((0.6, 0.4, 0.4), (1.9, 0.7, 0.9)).tolist()))
    name = f"bench-{index}"
    x, y = layout.place(name, candidates(rng), reach_m=BENCH_REACH_M, apart_m=BENCH_REACH_M)
    yaw_rad = rng.uniform(-np.pi, np.pi)
    return standing_body(name, shape, x, y, Surface(albedo=rng.uniform(0.3, 0.7)), yaw_rad=yaw_rad)
