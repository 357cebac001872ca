"""What a world consists of, as plain data: solids, their looks, and the weather they are seen in."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from voxdepth.types import FloatArray

from .errors import SceneError
from .model import Model

BodyKind = Literal["building", "ground"]
"""What a contact with a body counts as. Everything that stands on the ground is a building, trees included."""
Pattern = Literal["plain", "facade", "ground", "grass", "foliage", "bark", "snow"]


@dataclass(frozen=True)
class Box:
    """Axis-aligned in its own frame; the origin is the centre."""

    size_m: tuple[float, float, float]

    def __post_init__(self) -> None:
        _require_positive("the sides of a box", *self.size_m)


@dataclass(frozen=True)
class Cylinder:
    """Its axis is z; the origin is the centre."""

    radius_m: float
    height_m: float

    def __post_init__(self) -> None:
        _require_positive("radius and height of a cylinder", self.radius_m, self.height_m)


@dataclass(frozen=True)
class Sphere:
    """The origin is the centre."""

    radius_m: float

    def __post_init__(self) -> None:
        _require_positive("the radius of a sphere", self.radius_m)


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface of triangles, seen counter-clockwise from outside."""

    vertices_m: FloatArray
    """Shape (V, 3)."""
    triangles: npt.NDArray[np.uint32]
    """Vertex indices, shape (T, 3)."""

    def __post_init__(self) -> None:
        if len(self.triangles) == 0 or self.vertices_m.ndim != 2 or self.vertices_m.shape[1] != 3:
            raise SceneError(
                f"a mesh needs vertices of shape (V, 3) and at least one triangle, got vertices of shape "
                f"{self.vertices_m.shape} and {len(self.triangles)} triangles"
            )


@dataclass(frozen=True, eq=False)
class Heightfield:
    """Ground of varying height on a square grid; the origin is the middle of the grid at height 0."""

    height_m: FloatArray
    """Height at each grid point, shape (rows along y, columns along x)."""
    spacing_m: float
    """Distance between neighbouring grid points."""

    def __post_init__(self) -> None:
        _require_positive("the spacing of a heightfield", self.spacing_m)
        if self.height_m.ndim != 2 or min(self.height_m.shape) < 2 or not np.isfinite(self.height_m).all():
            raise SceneError(f"a heightfield needs at least 2 x 2 finite heights, got shape {self.height_m.shape}")


Shape = Box | Cylinder | Sphere | Mesh | Heightfield


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


class Weather(Model):
    """Light and air. The default is a clear day with a high sun."""

    sun_azimuth_deg: float = -38.0
    """Direction to the sun, from the world's x axis towards y."""
    sun_elevation_deg: float = Field(55.0, gt=0, le=90)
    ambient: float = Field(0.55, ge=0, le=1)
    """Share of the light that comes from everywhere: 1 is an overcast sky without contrast."""
    shadows: bool = False
    """Whether static bodies cast shadows; costs as many rays as the picture itself."""
    haze_m: float = Field(260.0, gt=0)
    """Distance over which the air hides 63 % of what is behind it."""
    sky: float = Field(0.80, ge=0, le=1)
    """Brightness at the horizon, which haze fades to."""
    clouds: float = Field(0.22, ge=0)
    """Contrast of the clouds; 0 is a uniform sky."""
    exposure: float = Field(1.25, gt=0)

    @property
    def to_sun(self) -> tuple[float, float, float]:
        """Unit vector towards the sun in the world frame."""
        azimuth, elevation = np.radians([self.sun_azimuth_deg, self.sun_elevation_deg])
        flat = np.cos(elevation)
        return float(np.cos(azimuth) * flat), float(np.sin(azimuth) * flat), float(np.sin(elevation))


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All static bodies; the seed also decides their textures."""

    seed: int
    bodies: tuple[Body, ...]
    weather: Weather = field(default_factory=Weather)
    path_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)), compare=False)
    """Way points on the ground, shape (n, 3), along which the builder left room for a camera; none if it left none."""


class SceneSpec(Model, ABC):
    """What every kind of scene can be asked for."""

    weather: Weather = Weather()

    @abstractmethod
    def build(self, seed: int) -> Scene:
        """The scene of a seed.

        Raises:
            SceneError: The specification cannot be built.
        """


def _require_positive(what: str, *lengths_m: float) -> None:
    if not all(0 < length < np.inf for length in lengths_m):
        raise SceneError(f"{what} must be positive and finite, got {', '.join(f'{x:g}' for x in lengths_m)} m")
