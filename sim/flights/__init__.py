"""Camera trajectories along the path of a scene, each from a seed and a configuration."""

from typing import Annotated

from pydantic import Field

from .drone import Drone
from .kinematic import Cut, Hover, Stations, Walk
from .trajectory import Flight

AnyFlight = Annotated[Walk | Drone | Hover | Cut | Stations, Field(discriminator="kind")]

__all__ = ["AnyFlight", "Cut", "Drone", "Flight", "Hover", "Stations", "Walk"]
