"""A city of towers, between which the swarm of the paper flies."""

import math
from itertools import chain
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.arithmetic import length
from voxdepth.types import FloatArray

from ..bodies import Body, Box, Cylinder, Mover, Scene, SceneSpec, Surface, shuttle, standing_body
from ..seeds import Purpose, stream
from .layout import PAVED, Range, flat_ground, random_share, with_changed_share, with_surface

TEXTURELESS, WEAK, GLASSY, WIRES, MOVERS = range(1, 6)
"""Keys of the random streams of what was added to towers and poles, so that none of them moves a tower or a pole."""
POLE_SHIFT_M = 0.5
"""Largest distance of a pole from the middle of its street."""
GLASS = {"albedo": 0.2, "texture": 0.0, "pane_m": 1.5}
"""Glass is dark, without a texture of its own, in dark frames: the module of usual curtain walls is 1.2 to 1.5 m."""
PATH_CLEARANCE_M = 0.5
"""Free width that a path needs on both sides."""
MOVER_LANE_M, MOVER_SIDE_M, MOVER_TALL_M = 1.2, 0.8, 2.4
"""Distance of the movers' ways from the middle of their street, and the movers' width and height."""


class CitySpec(SceneSpec):
    """A city of towers on a brick-like grid of lots, with poles in the streets. Flights lead along x."""

    kind: Literal["city"] = "city"
    columns: int = Field(default=6, ge=1, le=100)
    """Number of rows of towers that a flight along x passes."""
    rows: int = Field(default=10, ge=1, le=100)
    """Number of towers along y."""
    street_width_m: float = Field(default=6.0, gt=1.0)
    """Mean gap between towers [m]; a narrower gap is harder."""
    tower_side_m: Range = (3.5, 5.5)
    """Range of the towers' sides [m]."""
    tower_height_m: Range = (12.0, 40.0)
    """Range of the towers' heights [m]."""
    jitter_m: float = Field(default=0.6, ge=0)
    """Largest shift of a tower from the middle of its lot, along each axis [m]."""
    blank_share: float = Field(default=0.0, ge=0, le=1)
    """Share of the towers that are textureless, which a stereo camera cannot match."""
    weak_share: float = Field(default=0.0, ge=0, le=1)
    """Share of the towers with a weak texture, as of plaster, which a stereo camera matches in parts; those without
    texture stay so."""
    weak_texture: Range = (0.05, 0.2)
    """Range of the strengths of a weak texture; 1 is that of the other towers."""
    glass_share: float = Field(default=0.0, ge=0, le=1)
    """Share of the towers that are of glass, whose depth is that of what they reflect."""
    glass_reflectivity: float = Field(default=0.8, gt=0, le=1)
    """Share of the light that glass reflects."""
    poles: int = Field(default=16, ge=0, le=5_000)
    """Thin vertical poles in the streets."""
    pole_radius_m: float = Field(default=0.12, gt=0)
    wires: int = Field(default=0, ge=0)
    """Thin level wires, each from a tower to a pole of its own halfway across a gap or a street, whose other half stays
    free."""
    wire_m: Range = (0.02, 0.04)
    """Range of the wires' thicknesses [m]."""
    wire_height_m: Range = (4.5, 7.5)
    """Range of the wires' heights [m], below the tops of the towers."""
    movers: int = Field(default=0, ge=0)
    """Crates and drums that go to and fro along the streets in direction y, between the poles and the towers."""
    mover_speed_m_s: Range = (0.5, 1.5)
    """Range of the movers' speeds [m/s]."""
    mover_way_m: Range = (4.0, 10.0)
    """Range of the lengths of the movers' ways [m]."""
    mover_waits_m: float = Field(default=0.0, ge=0)
    """Distance of a drone at which a mover waits; 0 never waits."""
    mover_height_m: float = Field(default=6.0, gt=1.0)
    """Height of the middle of the movers [m], that of the flight."""

    @model_validator(mode="after")
    def _check(self) -> "CitySpec":
        if self.wires and self.columns * self.rows < 2:
            raise ValueError(f"wires lead from tower to tower, got {self.wires} wires and a single tower")
        return self

    @property
    def pitch_m(self) -> float:
        """Distance between the middles of neighbouring lots [m]."""
        return sum(self.tower_side_m) / 2 + self.street_width_m

    def build(self, seed: int) -> Scene:
        """Return the city of a seed: it begins at x = 0 and is centred on y = 0."""
        rng = stream(seed, Purpose.SCENE)
        ground = flat_ground(self.columns * self.pitch_m / 2, PAVED)
        towers = [_tower(self, rng, column, row) for column in range(self.columns) for row in range(self.rows)]
        poles = [_pole(self, rng, i) for i in range(self.poles)]
        textureless, weak, glassy = (stream(seed, Purpose.SCENE, key) for key in (TEXTURELESS, WEAK, GLASSY))
        towers = with_changed_share(towers, self.blank_share, textureless, texture=0.0)
        towers = _weakened(self, weak, towers)
        towers = with_changed_share(towers, self.glass_share, glassy, **GLASS, reflectivity=self.glass_reflectivity)
        wired = [_wire(self, stream(seed, Purpose.SCENE, WIRES, i), i, towers) for i in range(self.wires)]
        movers = tuple(_mover(self, stream(seed, Purpose.SCENE, MOVERS, i), i) for i in range(self.movers))
        bodies = (ground, *towers, *poles, *chain.from_iterable(wired))
        return Scene(seed=seed, bodies=bodies, movers=movers, weather=self.weather, path_m=self._path_m())

    def _path_m(self) -> FloatArray:
        """Return a path along the first street in direction y, between poles and towers; empty in narrow streets."""
        to_pole_m = POLE_SHIFT_M + self.pole_radius_m
        to_tower_m = (self.pitch_m - self.tower_side_m[1]) / 2 - self.jitter_m
        if to_tower_m - to_pole_m < 2 * PATH_CLEARANCE_M:
            return np.zeros((0, 3))
        x, side = self.pitch_m - (to_pole_m + to_tower_m) / 2, self.rows * self.pitch_m / 2
        return np.array([[x, -side, 0.0], [x, side, 0.0]])


def _tower(spec: CitySpec, rng: np.random.Generator, column: int, row: int) -> Body:
    side_x, side_y = rng.uniform(*spec.tower_side_m, 2).tolist()
    height = rng.uniform(*spec.tower_height_m)
    shift_x, shift_y = rng.uniform(-spec.jitter_m, spec.jitter_m, 2).tolist()
    brick = 0.5 if column % 2 else 0.0
    x = (column + 0.5) * spec.pitch_m + shift_x
    y = (row + brick - (spec.rows - 0.5) / 2) * spec.pitch_m + shift_y
    surface = Surface(albedo=rng.uniform(0.3, 0.75), pattern="facade")
    return standing_body(f"tower-{column}-{row}", Box((side_x, side_y, height)), x, y, surface)


def _weakened(spec: CitySpec, rng: np.random.Generator, towers: list[Body]) -> list[Body]:
    """Return the towers, of which a random share of those with a texture has a weak one."""
    strengths = rng.uniform(*spec.weak_texture, len(towers))
    chosen = random_share(spec.weak_share, len(towers), rng)
    return [
        with_surface(tower, texture=float(strength)) if is_chosen and tower.surface.texture else tower
        for tower, strength, is_chosen in zip(towers, strengths, chosen, strict=True)
    ]


def _pole(spec: CitySpec, rng: np.random.Generator, index: int) -> Body:
    """Return a pole near the middle of a street in direction y."""
    column = int(rng.integers(0, spec.columns))
    x = (column + 1) * spec.pitch_m + rng.uniform(-POLE_SHIFT_M, POLE_SHIFT_M)
    y = rng.uniform(-0.5, 0.5) * spec.rows * spec.pitch_m
    shape = Cylinder(spec.pole_radius_m, rng.uniform(8.0, 11.0))
    return standing_body(f"pole-{index}", shape, x, y, Surface(albedo=rng.uniform(0.2, 0.7)))


def _wire(spec: CitySpec, rng: np.random.Generator, index: int, towers: list[Body]) -> list[Body]:
    """Return a wire from the middle of a tower halfway to that of the next one along y or x, and its pole there."""
    along_y = spec.columns == 1 or (spec.rows > 1 and rng.uniform() < 0.5)
    column = int(rng.integers(spec.columns - (not along_y)))
    row = int(rng.integers(spec.rows - along_y))
    towers = [towers[column * spec.rows + row], towers[(column + (not along_y)) * spec.rows + row + along_y]]
    if rng.uniform() < 0.5:
        towers.reverse()
    start_m, next_m = (np.array(tower.position_m[:2]) for tower in towers)
    pole_m, middle_m = (start_m + next_m) / 2, (3 * start_m + next_m) / 4
    thickness_m, height_m = float(rng.uniform(*spec.wire_m)), float(rng.uniform(*spec.wire_height_m))
    surface = Surface(albedo=float(rng.uniform(0.1, 0.4)))
    wire = Body(
        name=f"wire-{index}",
        shape=Box((length(pole_m - start_m), thickness_m, thickness_m)),
        position_m=(float(middle_m[0]), float(middle_m[1]), height_m),
        yaw_rad=math.atan2(*(pole_m - start_m)[::-1]),
        surface=surface,
    )
    pole = Cylinder(spec.pole_radius_m, height_m + thickness_m)
    return [wire, standing_body(f"wire-pole-{index}", pole, float(pole_m[0]), float(pole_m[1]), surface)]


def _mover(spec: CitySpec, rng: np.random.Generator, index: int) -> Mover:
    """Return a crate or a drum that goes to and fro on one side of a street in direction y."""
    column, side = int(rng.integers(spec.columns)), int(rng.choice((-1, 1)))
    x = (column + 1) * spec.pitch_m + side * MOVER_LANE_M
    way_m = float(rng.uniform(*spec.mover_way_m))
    y = float(rng.uniform(-0.5, 0.5)) * spec.rows * spec.pitch_m
    surface = Surface(albedo=float(rng.uniform(0.3, 0.7)))
    drum, crate = Cylinder(MOVER_SIDE_M / 2, MOVER_TALL_M), Box((MOVER_SIDE_M, MOVER_SIDE_M, MOVER_TALL_M))
    shape: Box | Cylinder = drum if rng.uniform() < 0.5 else crate
    return shuttle(
        Body(name=f"mover-{index}", kind="mover", shape=shape, surface=surface),
        np.array([x, y - way_m / 2, spec.mover_height_m]),
        np.array([x, y + way_m / 2, spec.mover_height_m]),
        speed_m_s=float(rng.uniform(*spec.mover_speed_m_s)),
        travelled_m=float(rng.uniform(0, 2 * way_m)),
        waits_m=spec.mover_waits_m,
    )
