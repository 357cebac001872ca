"""A world of one's own: a list of boxes, cylinders and spheres."""

from collections import Counter
from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.model import Model

from ..bodies import Body, Box, Cylinder, Mover, Scene, SceneSpec, Sphere, Surface, shuttle
from ..errors import SceneError
from .layout import PAVED, flat_ground

SHAPES = {("size_m",): Box, ("radius_m", "height_m"): Cylinder, ("radius_m",): Sphere}
"""What a body is by the keys that it has."""
Triple = Annotated[tuple[float, float, float], Field(strict=False)]


class ListedBody(Model):
    """A box has `size_m`, a cylinder `radius_m` and `height_m`, and a sphere `radius_m`.

    It stands, or it moves back and forth between `position_m` and `to_m` at constant speed without turning.
    """

    name: str | None = Field(default=None, pattern=r"^[\w.-]+$")
    """Name in contacts and recordings; None takes its number in the list, as in `body-0`."""
    position_m: Triple
    """Position of its centre."""
    yaw_deg: float = 0.0
    size_m: Triple | None = None
    radius_m: float | None = None
    height_m: float | None = None
    surface: Surface = Surface()
    to_m: Triple | None = None
    speed_m_s: float = Field(default=1.0, gt=0)
    waits_m: float = Field(default=0.0, ge=0)
    """It waits while a drone is within this distance of its position; 0 never waits."""

    @model_validator(mode="after")
    def _check(self) -> "ListedBody":
        self.shape  # noqa: B018  # An impossible one is an error.
        if self.to_m == self.position_m:
            raise ValueError(f"expected two places, got {list(self.position_m)} as position_m and as to_m: change one")
        return self

    @property
    def shape(self) -> Box | Cylinder | Sphere:
        """Its shape, by the lengths that are given."""
        keys = ("size_m", "radius_m", "height_m")
        given = {key: value for key in keys if (value := getattr(self, key)) is not None}
        if tuple(given) not in SHAPES:
            raise ValueError(
                "expected size_m for a box, radius_m and height_m for a cylinder, or radius_m for a sphere, got "
                f"{' and '.join(given) or 'none of them'}: choose one shape"
            )
        shape: Box | Cylinder | Sphere = SHAPES[tuple(given)](*given.values())
        return shape

    def body(self, name: str) -> Body:
        """Return the body at `position_m`."""
        yaw_rad = float(np.radians(self.yaw_deg))
        return Body(name=name, shape=self.shape, position_m=self.position_m, yaw_rad=yaw_rad, surface=self.surface)

    def mover(self, body: Body) -> Mover:
        """Return the body as one that moves to `to_m` and back."""
        ends_m = np.array(self.position_m), np.array(self.to_m)
        return shuttle(replace(body, kind="mover"), *ends_m, speed_m_s=self.speed_m_s, waits_m=self.waits_m)


class ListedSpec(SceneSpec):
    """Bodies of one's own on flat ground at height 0. The seed decides their textures only."""

    kind: Literal["listed"] = "listed"
    bodies: tuple[ListedBody, ...] = Field(default=(), strict=False)
    path_m: tuple[Triple, ...] = Field(default=(), strict=False)
    """Way points on the ground for the flights of recorded sequences; drones do not need them."""

    def build(self, seed: int) -> Scene:
        """Return the ground and the listed bodies, in order."""
        listed = [(one, one.body(one.name or f"body-{index}")) for index, one in enumerate(self.bodies)]
        name, count = Counter(["ground", *(body.name for _, body in listed)]).most_common(1)[0]
        if count > 1:
            raise SceneError(f"expected a name of its own for each body, got {name!r} {count} times: rename one")
        return Scene(
            seed=seed,
            bodies=(flat_ground(0.0, PAVED), *(body for one, body in listed if one.to_m is None)),
            movers=tuple(one.mover(body) for one, body in listed if one.to_m is not None),
            weather=self.weather,
            path_m=np.array(self.path_m).reshape(-1, 3),
        )
