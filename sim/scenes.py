"""What a world consists of, as plain data built from a seed and a specification."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from .model import Model
from .seeds import Purpose, stream

BodyKind = Literal["building", "ground"]
Pattern = Literal["plain", "facade", "ground"]


@dataclass(frozen=True)
class Box:
    """Axis-aligned in its own frame; the origin is the centre."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True)
class Cylinder:
    """Its axis is z; the origin is the centre."""

    radius_m: float
    height_m: float


@dataclass(frozen=True)
class Sphere:
    """The origin is the centre."""

    radius_m: float


Shape = Box | Cylinder | Sphere


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Looks of a body."""

    albedo: float = 0.5
    """Share of light that comes back, 0..1."""
    texture: float = 1.0
    """Strength of the texture; 0 is blank, which a stereo camera cannot match."""
    pattern: Pattern = "plain"


@dataclass(frozen=True, kw_only=True)
class Body:
    """One static thing in the world."""

    name: str
    kind: BodyKind
    shape: Shape
    position_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    surface: Surface = field(default_factory=Surface)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All static bodies; the seed also decides their textures."""

    seed: int
    bodies: tuple[Body, ...]


class CitySpec(Model):
    """A city of towers on a brick-like grid of lots, with poles in the streets. Flights lead along x."""

    kind: Literal["city"] = "city"
    columns: int = Field(6, ge=1)
    """Rows of towers that a flight along x passes."""
    rows: int = Field(10, ge=1)
    """Towers side by side, along y."""
    street_width_m: float = Field(6.0, gt=1.0)
    """Mean gap between towers [m]: the difficulty knob; narrower is harder."""
    tower_side_m: tuple[float, float] = Field((3.5, 5.5), strict=False)
    """Range of the towers' sides [m]."""
    tower_height_m: tuple[float, float] = Field((12.0, 40.0), strict=False)
    """Range of the towers' heights [m]."""
    jitter_m: float = Field(0.6, ge=0)
    """Largest shift of a tower from the middle of its lot, along each axis [m]."""
    poles: int = Field(16, ge=0)
    """Thin vertical poles in the streets."""
    pole_radius_m: float = Field(0.12, gt=0)

    @model_validator(mode="after")
    def _check(self) -> "CitySpec":
        for name in ("tower_side_m", "tower_height_m"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ValueError(f"{name} must be a range of positive lengths, low before high, got [{low}, {high}]")
        return self

    @property
    def pitch_m(self) -> float:
        """Distance between the middles of neighbouring lots [m]."""
        return sum(self.tower_side_m) / 2 + self.street_width_m


def build_city(spec: CitySpec, seed: int) -> Scene:
    """The city of a seed: it begins at x = 0 and is centred on y = 0."""
    rng = stream(seed, Purpose.SCENE)
    ground = Body(
        name="ground",
        kind="ground",
        shape=Box((400.0, 400.0, 1.0)),
        position_m=(spec.columns * spec.pitch_m / 2, 0.0, -0.5),
        surface=Surface(albedo=0.38, pattern="ground"),
    )
    towers = [_tower(spec, rng, column, row) for column in range(spec.columns) for row in range(spec.rows)]
    poles = [_pole(spec, rng, i) for i in range(spec.poles)]
    return Scene(seed=seed, bodies=(ground, *towers, *poles))


def _tower(spec: CitySpec, rng: np.random.Generator, column: int, row: int) -> Body:
    side_x, side_y = rng.uniform(*spec.tower_side_m, 2)
    height = rng.uniform(*spec.tower_height_m)
    shift_x, shift_y = rng.uniform(-spec.jitter_m, spec.jitter_m, 2)
    brick = 0.5 if column % 2 else 0.0
    x = (column + 0.5) * spec.pitch_m + shift_x
    y = (row + brick - (spec.rows - 0.5) / 2) * spec.pitch_m + shift_y
    return Body(
        name=f"tower-{column}-{row}",
        kind="building",
        shape=Box((float(side_x), float(side_y), float(height))),
        position_m=(float(x), float(y), float(height / 2)),
        surface=Surface(albedo=float(rng.uniform(0.3, 0.75)), pattern="facade"),
    )


def _pole(spec: CitySpec, rng: np.random.Generator, index: int) -> Body:
    """A pole on the line between two columns of towers, where the streets along y run."""
    column = rng.integers(0, spec.columns)
    x = (column + 1) * spec.pitch_m + rng.uniform(-0.5, 0.5)
    y = rng.uniform(-0.5, 0.5) * spec.rows * spec.pitch_m
    height = rng.uniform(8.0, 11.0)
    return Body(
        name=f"pole-{index}",
        kind="building",
        shape=Cylinder(spec.pole_radius_m, float(height)),
        position_m=(float(x), float(y), float(height / 2)),
        surface=Surface(albedo=float(rng.uniform(0.2, 0.7))),
    )
