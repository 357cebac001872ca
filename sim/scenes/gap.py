"""Walls across the path, each with one narrow gap."""

from typing import Literal

import numpy as np
from pydantic import Field

from voxdepth.types import FloatArray

from ..bodies import Body, Box, Cylinder, Pattern, Scene, SceneSpec, Surface, standing_body
from ..seeds import Purpose, stream
from .layout import PAVED, WAY_POINT_STEP_M, flat_ground

WALLS, POSTS = range(2)
"""Keys of random streams."""
WALL_DEPTH_M = 0.8
SIDE_M = 40.0
"""Extent of the walls to both sides; every gap lies within it."""
POST_RADIUS_M, POST_HEIGHT_M = 0.12, 9.0


class GapSpec(SceneSpec):
    """High walls across the path, one after the other. The path leads along x, from gap to gap."""

    kind: Literal["gap"] = "gap"
    walls: int = Field(default=3, ge=1, le=1_000)
    gap_m: float = Field(default=4.0, gt=1.5, le=30)
    """Width of each gap [m]; a narrower gap is harder."""
    spacing_m: float = Field(default=22.0, gt=4)
    """Distance between successive walls [m]."""
    shift_m: float = Field(default=5.0, ge=0, le=20)
    """Largest distance of a gap from y = 0 [m]."""
    height_m: float = Field(default=14.0, gt=0)
    blank_share: float = Field(default=0.0, ge=0, le=1)
    """Probability that each half of a wall is textureless, which a stereo camera cannot match."""
    posts: int = Field(default=8, ge=0, le=5_000)
    """Number of thin posts between the walls."""

    def build(self, seed: int) -> Scene:
        """Return the gaps of a seed: the first wall is at x = `spacing_m`, and the path starts at x = 0."""
        gaps_m = [stream(seed, Purpose.SCENE, WALLS, i).uniform(-self.shift_m, self.shift_m) for i in range(self.walls)]
        halves = [body for i, y in enumerate(gaps_m) for body in _wall(self, seed, i, y)]
        posts = [_post(self, seed, i) for i in range(self.posts)]
        bodies = (flat_ground(self.spacing_m * (self.walls + 1) / 2, PAVED), *halves, *posts)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=_path_m(self, gaps_m))


def _path_m(spec: GapSpec, gaps_m: list[float]) -> FloatArray:
    """Return straight lines from gap to gap, perpendicular to each wall."""
    walls_m = spec.spacing_m * (np.arange(spec.walls) + 1)
    square_m = np.stack([walls_m - spec.spacing_m / 4, walls_m + spec.spacing_m / 4], axis=1).ravel()
    length_m = spec.spacing_m * (spec.walls + 1)
    x = np.linspace(0, length_m, round(length_m / WAY_POINT_STEP_M) + 1)
    return np.stack([x, np.interp(x, square_m, np.repeat(gaps_m, 2)), np.zeros_like(x)], axis=1)


def _wall(spec: GapSpec, seed: int, index: int, gap_m: float) -> list[Body]:
    """Return both halves of a wall."""
    rng = stream(seed, Purpose.SCENE, WALLS, index, 1)
    pattern: Pattern = "facade" if rng.uniform() < 0.5 else "plain"
    albedo = rng.uniform(0.35, 0.75)
    textureless = rng.uniform(size=2) < spec.blank_share
    x = (index + 1) * spec.spacing_m
    ends_m = ((gap_m + spec.gap_m / 2, SIDE_M), (-SIDE_M, gap_m - spec.gap_m / 2))
    walls = []
    for name, (low, high), is_textureless in zip(("left", "right"), ends_m, textureless, strict=True):
        shape = Box((WALL_DEPTH_M, high - low, spec.height_m))
        surface = Surface(albedo=albedo, pattern=pattern, texture=0.0 if is_textureless else 1.0)
        walls.append(standing_body(f"wall-{index}-{name}", shape, x, (low + high) / 2, surface))
    return walls


def _post(spec: GapSpec, seed: int, index: int) -> Body:
    """Return a post between two walls, beside their gaps."""
    rng = stream(seed, Purpose.SCENE, POSTS, index)
    wall = int(rng.integers(spec.walls + 1))
    x = (wall + rng.uniform(0.35, 0.65)) * spec.spacing_m
    y = int(rng.choice((-1, 1))) * (spec.shift_m + spec.gap_m / 2 + rng.uniform(0.5, 4.0))
    shape = Cylinder(POST_RADIUS_M, POST_HEIGHT_M)
    return standing_body(f"post-{index}", shape, x, y, Surface(albedo=rng.uniform(0.2, 0.7)))
