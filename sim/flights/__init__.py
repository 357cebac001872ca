"""Kinds of flights: camera trajectories along the path of a scene, each from a seed and a configuration."""

from typing import Annotated

from pydantic import Field

from .cut import Cut
from .drone import Drone
from .hover import Hover, Yaw
from .motion import Flight
from .walk import Walk

AnyFlight = Annotated[Walk | Drone | Hover | Yaw | Cut, Field(discriminator="kind")]

__all__ = ["AnyFlight", "Cut", "Drone", "Flight", "Hover", "Walk", "Yaw"]
