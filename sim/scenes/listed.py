"""A world of one's own: a list of boxes, cylinders, spheres and URDF files."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationInfo, field_validator, model_validator

from ..bodies import Body, Box, Cylinder, Mover, Scene, SceneSpec, Sphere, Surface, shuttle
from ..errors import SceneError
from ..types import Model
from ..urdf import parts_of
from .layout import PAVED, flat_ground

SHAPES = {("size_m",): Box, ("radius_m", "height_m"): Cylinder, ("radius_m",): Sphere, ("urdf",): Path}
"""What a body is by the keys that it has."""
Triple = Annotated[tuple[float, float, float], Field(strict=False)]


class ListedBody(Model):
    """A box has `size_m`, a cylinder `radius_m` and `height_m`, a sphere `radius_m`; or there is a `urdf`.

    It stands, or it moves back and forth between `position_m` and `to_m` at constant speed without turning.
    """

    name: str | None = Field(default=None, pattern=r"^[\w.-]+$")
    """Name in contacts and recordings; None takes its number in the list, as in `body-0`."""
    position_m: Triple
    """Position of its centre, or of the frame of the root link of a URDF."""
    yaw_deg: float = 0.0
    size_m: Triple | None = None
    radius_m: float | None = None
    height_m: float | None = None
    urdf: str | None = None
    """A file: from the folder of the scenario, from the current one, or from that of `pybullet_data`. Cameras see its
    visible shapes and drones touch them, with all joints at zero."""
    scale: float = Field(default=1.0, gt=0)
    """Factor of all lengths of a URDF."""
    surface: Surface | None = None
    """Its look; None takes the defaults, and the colours of a URDF."""
    to_m: Triple | None = None
    speed_m_s: float = Field(default=1.0, gt=0)
    waits_m: float = Field(default=0.0, ge=0)
    """It waits while a drone is within this distance of its position; 0 never waits."""

    @field_validator("urdf")
    @classmethod
    def _beside_scenario(cls, urdf: str | None, info: ValidationInfo) -> str | None:
        """The whole path of a file beside the scenario, so that the copy of the scenario in a result finds it."""
        beside = Path((info.context or {}).get("folder", ""), urdf or "").absolute()
        return str(beside) if beside.is_file() else urdf

    @model_validator(mode="after")
    def _check(self) -> "ListedBody":
        self.shape  # noqa: B018  # An impossible one is an error.
        if self.to_m == self.position_m:
            raise ValueError(f"expected two places, got {list(self.position_m)} as position_m and as to_m: change one")
        return self

    @property
    def shape(self) -> Box | Cylinder | Sphere | Path:
        """Its shape, or the file of its shapes."""
        keys = ("size_m", "radius_m", "height_m", "urdf")
        given = {key: value for key in keys if (value := getattr(self, key)) is not None}
        if tuple(given) not in SHAPES:
            raise ValueError(
                "expected size_m for a box, radius_m and height_m for a cylinder, radius_m for a sphere, or urdf, got "
                f"{' and '.join(given) or 'none of them'}: choose one shape"
            )
        shape: Box | Cylinder | Sphere | Path = SHAPES[tuple(given)](*given.values())
        return shape

    def bodies(self, name: str) -> Iterator[Body]:
        """Its bodies at `position_m`; a URDF has one for each visible shape, named after its link."""
        shape, yaw_rad = self.shape, float(np.radians(self.yaw_deg))
        if not isinstance(shape, Path):
            surface = self.surface or Surface()
            yield Body(name=name, shape=shape, position_m=self.position_m, yaw_rad=yaw_rad, surface=surface)
            return
        for index, (link, mesh, albedo) in enumerate(parts_of(shape, self.scale)):
            surface, part = self.surface or Surface(albedo=albedo), f"{name}-{link}-{index}"
            yield Body(name=part, shape=mesh, position_m=self.position_m, yaw_rad=yaw_rad, surface=surface)

    def mover(self, body: Body) -> Mover:
        """One of its bodies as one that moves to `to_m` and back."""
        ends_m = np.array(self.position_m), np.array(self.to_m)
        return shuttle(replace(body, kind="mover"), *ends_m, speed_m_s=self.speed_m_s, waits_m=self.waits_m)


class ListedSpec(SceneSpec):
    """Bodies of one's own on flat ground at height 0. The seed decides their textures only."""

    kind: Literal["listed"] = "listed"
    bodies: tuple[ListedBody, ...] = Field(default=(), strict=False)
    path_m: tuple[Triple, ...] = Field(default=(), strict=False)
    """Way points on the ground for the flights of recorded sequences; drones do not need them."""

    def build(self, seed: int) -> Scene:
        """The ground and the listed bodies, in order."""
        named = [(one, one.name or f"body-{index}") for index, one in enumerate(self.bodies)]
        name, count = Counter(["ground", *(name for _, name in named)]).most_common(1)[0]
        if count > 1:
            raise SceneError(f"expected a name of its own for each body, got {name!r} {count} times: rename one")
        listed = [(one, body) for one, name in named for body in one.bodies(name)]
        return Scene(
            seed=seed,
            bodies=(flat_ground(0.0, PAVED), *(body for one, body in listed if one.to_m is None)),
            movers=tuple(one.mover(body) for one, body in listed if one.to_m is not None),
            weather=self.weather,
            path_m=np.array(self.path_m).reshape(-1, 3),
        )
