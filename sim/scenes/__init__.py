"""Kinds of scenes; each is built from a seed and a configuration, which sets its difficulty."""

from typing import Annotated

from pydantic import Field

from .city import CitySpec
from .corridor import CorridorSpec
from .forest import ForestSpec
from .gap import GapSpec
from .lawn import LawnSpec
from .plains import PlainsSpec
from .room import RoomSpec

AnyScene = Annotated[
    CitySpec | ForestSpec | CorridorSpec | GapSpec | PlainsSpec | LawnSpec | RoomSpec, Field(discriminator="kind")
]

__all__ = ["AnyScene", "CitySpec", "CorridorSpec", "ForestSpec", "GapSpec", "LawnSpec", "PlainsSpec", "RoomSpec"]
