"""A street between walls, many of them textureless, with a covered passage in its middle."""

from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.arithmetic import sin
from voxdepth.types import FloatArray

from ..bodies import Body, Box, Cylinder, Pattern, Scene, SceneSpec, Surface, standing_body
from ..seeds import Purpose, stream
from .layout import PAVED, WAY_POINT_STEP_M, flat_ground, with_changed_share

PATH, LEFT, RIGHT, TEXTURELESS, PASSAGE, PILLARS = range(6)
"""Keys of random streams."""
CLEARANCE_M = 1.25
"""Free width on both sides of the path."""
MAX_SWING_M = 0.8
WALL_DEPTH_M = 3.0
WALL_LENGTH_M, WALL_HEIGHT_M = (5.0, 14.0), (4.0, 10.0)
"""Ranges of the walls' lengths and heights."""
SETBACK_M = 1.0
"""Largest distance of a wall from the edge of the street."""
PASSAGE_HEIGHT_M = 3.0
CEILING_M = 2.5


class CorridorSpec(SceneSpec):
    """Two rows of walls of varying length, setback and height, with obstacles between them. The path leads along x."""

    kind: Literal["corridor"] = "corridor"
    length_m: float = Field(default=100.0, ge=70)
    """Extent along x [m]."""
    width_m: float = Field(default=6.0, ge=2.6)
    """Width of the street [m]; a narrower street is harder."""
    blank_share: float = Field(default=0.4, ge=0, le=1)
    """Share of the walls that are textureless, which a stereo camera cannot match."""
    passage_m: float = Field(default=12.0, ge=0)
    """Length of the covered passage [m]; 0 leaves it out."""
    passage_width_m: float = Field(default=3.2, ge=2.6)
    pillars: int = Field(default=14, ge=0, le=5_000)
    """Pillars, poles and boxes beside the path."""

    @model_validator(mode="after")
    def _check(self) -> "CorridorSpec":
        if self.passage_m > 0 and (self.passage_width_m > self.width_m or self.passage_m > self.length_m / 2):
            raise ValueError(
                f"the passage must be no wider than the street and at most half as long, got {self.passage_m} m x "
                f"{self.passage_width_m} m in {self.length_m} m x {self.width_m} m"
            )
        return self

    def build(self, seed: int) -> Scene:
        """Return the corridor of a seed: it begins at x = 0 and is centred on y = 0. The path leads along x."""
        path_m = _path(self, stream(seed, Purpose.SCENE, PATH))
        pillars = [_pillar(self, seed, i, path_m) for i in range(self.pillars)]
        # The choice of textureless walls has its own random stream, and moves no wall.
        walls = [*_row(self, seed, "left", LEFT, 1), *_row(self, seed, "right", RIGHT, -1)]
        walls = with_changed_share(walls, self.blank_share, stream(seed, Purpose.SCENE, TEXTURELESS), texture=0.0)
        bodies = (flat_ground(self.length_m / 2, PAVED), *walls, *_passage(self, seed), *pillars)
        return Scene(seed=seed, bodies=bodies, weather=self.weather, path_m=path_m)


def _path(spec: CorridorSpec, rng: np.random.Generator) -> FloatArray:
    """Return gentle curves within the street, straight through the passage."""
    x = np.linspace(0, spec.length_m, round(spec.length_m / WAY_POINT_STEP_M) + 1)
    swing_m = min(MAX_SWING_M, (spec.width_m / 2 - CLEARANCE_M) / 2)
    to_passage_m = np.abs(x - spec.length_m / 2) - spec.passage_m / 2
    swing = swing_m * np.clip(to_passage_m / 10 - 0.2, 0, 1)
    y = swing * sin(2 * np.pi * (x / rng.uniform(25, 40) + rng.uniform()))
    return np.stack([x, y, np.zeros_like(x)], axis=1)


def _row(spec: CorridorSpec, seed: int, name: str, key: int, side: int) -> list[Body]:
    """Return adjoining walls; the last one may extend beyond the street."""
    rng = stream(seed, Purpose.SCENE, key)
    walls: list[Body] = []
    end_m = 0.0
    while end_m < spec.length_m:
        start_m, end_m = end_m, end_m + rng.uniform(*WALL_LENGTH_M)
        height_m, setback_m = rng.uniform(*WALL_HEIGHT_M), rng.uniform(0, SETBACK_M)
        pattern: Pattern = "facade" if rng.uniform() < 0.5 else "plain"
        shape = Box((end_m - start_m, WALL_DEPTH_M, height_m))
        y = side * (spec.width_m / 2 + setback_m + WALL_DEPTH_M / 2)
        surface = Surface(albedo=rng.uniform(0.35, 0.75), pattern=pattern)
        walls.append(standing_body(f"wall-{name}-{len(walls)}", shape, (start_m + end_m) / 2, y, surface))
    return walls


def _passage(spec: CorridorSpec, seed: int) -> list[Body]:
    """Return two walls that narrow the street, and a ceiling on top of them."""
    if spec.passage_m == 0:
        return []
    rng = stream(seed, Purpose.SCENE, PASSAGE)
    surface = Surface(albedo=rng.uniform(0.35, 0.65))
    outer_m = spec.width_m / 2 + SETBACK_M + WALL_DEPTH_M / 2
    inner_m = spec.passage_width_m / 2
    depth_m, middle_m = outer_m - inner_m, (outer_m + inner_m) / 2
    x, side = spec.length_m / 2, Box((spec.passage_m, depth_m, PASSAGE_HEIGHT_M))
    ceiling = Box((spec.passage_m, 2 * outer_m, CEILING_M))
    ceiling_at_m = (x, 0.0, PASSAGE_HEIGHT_M + CEILING_M / 2)
    return [
        standing_body("passage-left", side, x, middle_m, surface),
        standing_body("passage-right", side, x, -middle_m, surface),
        Body(name="passage-ceiling", shape=ceiling, position_m=ceiling_at_m, surface=surface),
    ]


def _pillar(spec: CorridorSpec, seed: int, index: int, path_m: FloatArray) -> Body:
    """Return an obstacle between the clearance of the path and the wall, or half in the wall of a narrow street."""
    rng = stream(seed, Purpose.SCENE, PILLARS, index)
    shape, reach_m = _obstacle(rng)
    x = (index + rng.uniform(0.2, 0.8)) / spec.pillars * (spec.length_m - spec.passage_m)
    if x > (spec.length_m - spec.passage_m) / 2:
        x += spec.passage_m
    side = rng.choice((-1, 1))
    near_m = np.interp(x, path_m[:, 0], path_m[:, 1]) + side * (CLEARANCE_M + reach_m)
    space_m = max(0.0, spec.width_m / 2 - reach_m - side * near_m)
    y, yaw_rad = float(near_m + side * space_m * rng.uniform()), rng.uniform(-np.pi, np.pi)
    surface = Surface(albedo=rng.uniform(0.2, 0.7), texture=rng.uniform(0.5, 1.0))
    return standing_body(f"pillar-{index}", shape, x, y, surface, yaw_rad=yaw_rad)


def _obstacle(rng: np.random.Generator) -> tuple[Box | Cylinder, float]:
    """Return a pillar, a pole or a box, and its largest distance from its axis [m]."""
    kind = rng.integers(3)
    size, height = rng.uniform(0.3, 0.6), rng.uniform(2.5, 4.0)
    if kind == 0:
        return Box((size, size, height)), size / 2**0.5
    if kind == 1:
        return Cylinder(size / 5, height), size / 5
    return Box((size, 1.3 * size, 1.7 * size)), 0.82 * size
