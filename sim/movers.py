"""Things that move through the view of a camera, each on a path that its configuration gives."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatArray

from . import frames
from .bodies import Body, Sphere, Surface
from .model import Model
from .types import BodyPose

Place = Annotated[tuple[float, float, float], Field(strict=False)]
"""Ahead, to the left and above of the place where the camera begins [m]; level, by its first heading."""


class MovingSphere(Model):
    """A textured sphere that goes to and fro between two places at a constant speed, without turning.

    Nothing stops it: a path through a wall is flown. A recording ends with an error where it reaches the camera.
    """

    radius_m: float = Field(0.25, gt=0)
    from_m: Place
    """Where it is at time 0."""
    to_m: Place
    """Where it turns back."""
    speed_m_s: float = Field(gt=0)
    albedo: float = Field(0.6, ge=0, le=1)
    """Share of light that comes back."""
    texture: float = Field(1.0, ge=0)
    """Strength of its texture; 0 is blank, which a stereo camera cannot match."""

    @model_validator(mode="after")
    def _check(self) -> "MovingSphere":
        if self.from_m == self.to_m:
            raise ValueError(f"expected two places, but from_m and to_m are both {list(self.from_m)}: change one")
        return self

    def body(self, index: int) -> Body:
        """The sphere as a body, at the origin; the index tells movers apart."""
        surface = Surface(albedo=self.albedo, texture=self.texture)
        return Body(
            name=f"mover-{index}",
            kind="building",
            shape=Sphere(self.radius_m),
            position_m=(0.0, 0.0, 0.0),
            surface=surface,
        )

    def position_m(self, time_s: float, start: BodyPose) -> FloatArray:
        """Its centre in the world at a time, shape (3,).

        Args:
            time_s: Since the beginning.
            start: Where the camera's carrier is at the beginning.
        """
        way_m = np.subtract(self.to_m, self.from_m)
        length_m = float(np.linalg.norm(way_m))
        run_m = self.speed_m_s * time_s % (2 * length_m)
        share = min(run_m, 2 * length_m - run_m) / length_m
        q_level_xyzw = frames.quaternion_from_yaw(frames.yaw_from_quaternion(start.q_world_body_xyzw))
        place_m: FloatArray = np.asarray(self.from_m) + share * way_m
        position_m: FloatArray = start.position_m + frames.rotation_from_quaternion(q_level_xyzw) @ place_m
        return position_m
