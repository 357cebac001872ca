"""The bodies of a scene as plain data: their shapes, surfaces and motion, and the weather."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Annotated, Literal

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, model_validator

from voxdepth.arithmetic import length, matmul
from voxdepth.model import Model
from voxdepth.types import FloatArray

from . import frames
from .errors import SceneError
from .types import BodyPose

BodyKind = Literal["building", "ground", "mover", "drone"]
"""How a contact with a body is classified. Everything fixed on the ground is a building, trees included."""
Pattern = Literal["plain", "facade", "ground", "grass", "foliage", "bark", "snow"]
WELD_DECIMALS = 9
"""Decimals of the coordinates [m] by which vertices of a mesh are at the same position."""


class _Solid:
    """A convex shape whose fields are lengths."""

    def __post_init__(self) -> None:
        _require_positive(f"the lengths of {self}", *np.hstack(list(vars(self).values())))


@dataclass(frozen=True)
class Box(_Solid):
    """A box that is aligned with the axes of its own frame; the origin is its centre."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True)
class Cylinder(_Solid):
    """A cylinder along z; the origin is its centre."""

    radius_m: float
    height_m: float


@dataclass(frozen=True)
class Sphere(_Solid):
    """A sphere; the origin is its centre."""

    radius_m: float


@dataclass(frozen=True, eq=False)
class Mesh:
    """A closed surface of triangles, whose vertices run counter-clockwise when seen from outside."""

    vertices_m: FloatArray
    """Shape (V, 3)."""
    triangles: npt.NDArray[np.uint32]
    """Vertex indices, shape (T, 3)."""

    def __post_init__(self) -> None:
        if len(self.triangles) == 0 or self.vertices_m.ndim != 2 or self.vertices_m.shape[1] != 3:
            got = f"vertices of shape {self.vertices_m.shape} and {len(self.triangles)} triangles"
            raise SceneError(f"a mesh needs vertices of shape (V, 3) and at least one triangle, got {got}")

    @property
    def is_closed(self) -> bool:
        """Whether it is a closed surface whose triangles run counter-clockwise when seen from outside.

        Then each edge has one triangle on either side, and the enclosed volume is positive. Vertices at the same
        position count as one.
        """
        _, same = np.unique(self.vertices_m.round(WELD_DECIMALS), axis=0, return_inverse=True)
        corners = same.reshape(-1)[self.triangles]
        corners = corners[(corners != np.roll(corners, 1, axis=1)).all(axis=1)]
        ends = np.concatenate([corners[:, [i, (i + 1) % 3]] for i in range(3)])
        edges, backwards = np.sort(ends @ [1, len(same)]), np.sort(ends @ [len(same), 1])
        a, b, c = np.moveaxis(self.vertices_m[self.triangles] - self.vertices_m.mean(axis=0), 1, 0)
        volume_m3 = (a * np.cross(b, c)).sum() / 6
        return bool(volume_m3 > 0 and np.array_equal(edges, backwards) and (np.diff(edges) > 0).all())


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
    """Appearance of a body."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    albedo: Annotated[float, Field(ge=0, le=1)] = 0.5
    """Share of the light that is reflected, 0..1."""
    texture: Annotated[float, Field(ge=0)] = 1.0
    """Strength of the texture; a stereo camera cannot match a textureless surface, which has 0."""
    pattern: Pattern = "plain"
    gloss: float = 0.0
    """Share of the surface that returns no light of a projector to its camera, 0..1."""
    reflectivity: float = 0.0
    """Share of the light that a surface as smooth as glass reflects, 0..1: a stereo camera measures what it shows,
    which is farther away. Only the renderer `raster` draws it; in the others the surface reflects nothing."""
    pane_m: float = 0.0
    """Side of the panes of upright glass [m], between which there are frames that reflect nothing; 0 without frames."""

    @property
    def is_blank(self) -> bool:
        """Whether a stereo camera has nothing to match on it."""
        return self.texture == 0 and self.reflectivity == 0


@dataclass(frozen=True, kw_only=True)
class Body:
    """One body of the world."""

    name: str
    kind: BodyKind = "building"
    shape: Shape
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    surface: Surface = field(default_factory=Surface)


@dataclass(frozen=True, kw_only=True)
class Mover:
    """A body that moves on its own way without turning. Collisions do not stop it."""

    body: Body
    position_m: Callable[[float], FloatArray]
    """The position of its origin in the world frame, shape (3,), by the time for which it has moved [s]."""
    waits_m: float = 0.0
    """It waits while a drone is within this distance of its origin, so that it hits nobody who does not see it; 0 never
    waits."""

    def at(self, time_s: float) -> Body:
        """Return the body where it is at a time."""
        x, y, z = self.position_m(time_s).tolist()
        return replace(self.body, position_m=(x, y, z))


def shuttle(
    body: Body,
    from_m: FloatArray,
    to_m: FloatArray,
    *,
    speed_m_s: float,
    travelled_m: float = 0.0,
    waits_m: float = 0.0,
) -> Mover:
    """Return a body that moves back and forth between two different positions at constant speed.

    Args:
        body: The body; its own position is ignored.
        from_m: One end of its way [m], shape (3,), in the frame that `Mover.position_m` of the result shall have.
        to_m: The other end, in the same frame [m], shape (3,).
        speed_m_s: Its speed.
        travelled_m: Way since it was at `from_m`, at time 0.
        waits_m: Distance of a drone within which it waits; see `Mover.waits_m`.
    """
    path_m = np.subtract(to_m, from_m)
    length_m = length(path_m)

    def position_m(time_s: float) -> FloatArray:
        way_m = (travelled_m + speed_m_s * time_s) % (2 * length_m)
        fraction = min(way_m, 2 * length_m - way_m) / length_m
        return np.asarray(from_m + fraction * path_m)

    return Mover(body=body, position_m=position_m, waits_m=waits_m)


def standing_body(
    name: str, shape: Box | Cylinder, x_m: float, y_m: float, surface: Surface, *, yaw_rad: float = 0.0
) -> Body:
    """Return a box or cylinder that stands on flat ground at height 0.

    Args:
        name: Its name in the scene.
        shape: The box, or the cylinder along z.
        x_m: World coordinate x of its centre.
        y_m: World coordinate y of its centre.
        surface: Its appearance.
        yaw_rad: Rotation about the vertical, from the world's x axis towards y.
    """
    height_m = shape.size_m[2] if isinstance(shape, Box) else shape.height_m
    return Body(name=name, shape=shape, position_m=(x_m, y_m, height_m / 2), yaw_rad=yaw_rad, surface=surface)


SPHERE_ALBEDO = 0.6
Offset = Annotated[tuple[float, float, float], Field(strict=False)]
"""Forward, left and up from the first position of the camera [m], level and along its first heading."""


class MovingSphere(Model):
    """A textured sphere that moves back and forth between two points at constant speed, without turning.

    Collisions do not stop it. A recording ends with an error where the sphere reaches the camera.
    """

    radius_m: float = Field(default=0.25, gt=0)
    from_m: Offset
    """Position at time 0."""
    to_m: Offset
    """Position where the sphere turns back."""
    speed_m_s: float = Field(gt=0)

    @model_validator(mode="after")
    def _check(self) -> "MovingSphere":
        if self.from_m == self.to_m:
            raise ValueError(f"expected two places, but from_m and to_m are both {list(self.from_m)}: change one")
        return self

    def mover(self, index: int, start: BodyPose) -> Mover:
        """Return the sphere in the world, named by its index, from the pose of the camera's carrier at time 0."""
        shape, surface = Sphere(self.radius_m), Surface(albedo=SPHERE_ALBEDO)
        body = Body(name=f"sphere-{index}", kind="mover", shape=shape, surface=surface)
        offset = shuttle(body, np.array(self.from_m), np.array(self.to_m), speed_m_s=self.speed_m_s)
        q_level_xyzw = frames.quaternion_from_yaw(frames.yaw_from_quaternion(start.q_world_body_xyzw))
        R_world_level = frames.rotation_from_quaternion(q_level_xyzw)
        return Mover(
            body=body, position_m=lambda time_s: start.position_m + matmul(R_world_level, offset.position_m(time_s))
        )


class WindConfig(Model):
    """Motion of the air, which carries drones along by their drag. By default it is still."""

    mean_m_s: tuple[float, float, float] = Field(default=(0.0, 0.0, 0.0), strict=False)
    """Mean velocity."""
    gust_m_s: float = Field(default=0.0, ge=0)
    """Standard deviation of the gusts along each axis."""
    gust_s: float = Field(default=2.0, gt=0)
    """Time in which a gust falls to 37 %."""


class Weather(Model):
    """Light, atmosphere and wind. The default is a clear and calm day with a high sun."""

    sun_azimuth_deg: float = -38.0
    """Direction to the sun, from the world's x axis towards y."""
    sun_elevation_deg: float = Field(default=55.0, gt=0, le=90)
    ambient: float = Field(default=0.55, ge=0, le=1)
    """Share of ambient light; 1 is an overcast sky without contrast."""
    shadows: bool = False
    """Whether static bodies cast shadows. Shadows cost as many rays as the image itself."""
    haze_m: float = Field(default=260.0, gt=0)
    """Distance at which haze hides 63 % of the light of a surface."""
    sky: float = Field(default=0.80, ge=0, le=1)
    """Brightness of the sky at the horizon, and of haze."""
    clouds: float = Field(default=0.22, ge=0)
    """Contrast of the clouds; 0 is a uniform sky."""
    exposure: float = Field(default=1.25, gt=0)
    wind: WindConfig = WindConfig()

    @property
    def to_sun(self) -> tuple[float, float, float]:
        """Unit vector towards the sun in the world frame."""
        azimuth, elevation = np.radians([self.sun_azimuth_deg, self.sun_elevation_deg])
        flat = math.cos(elevation)
        return math.cos(azimuth) * flat, math.sin(azimuth) * flat, math.sin(elevation)


@dataclass(frozen=True, kw_only=True)
class Scene:
    """All bodies except drones; the seed also decides their textures."""

    seed: int
    bodies: tuple[Body, ...]
    """Those that do not move."""
    movers: tuple[Mover, ...] = ()
    weather: Weather = field(default_factory=Weather)
    path_m: FloatArray = field(default_factory=lambda: np.zeros((0, 3)), compare=False)
    """Way points on the ground, shape (n, 3), of a path with free space for a camera; empty if the scene has none."""


class SceneSpec(Model, ABC):
    """The configuration of a scene; each kind of scene adds its own fields."""

    weather: Weather = Weather()

    @abstractmethod
    def build(self, seed: int) -> Scene:
        """Return the scene of a seed. A specification that cannot be built raises a `SceneError`."""


def _require_positive(what: str, *lengths_m: float) -> None:
    if not all(0 < length < np.inf for length in lengths_m):
        shown = ", ".join(f"{x:g}" for x in lengths_m)
        raise SceneError(f"{what} must be positive and finite, got {shown} m: give it a size, or leave it out")
