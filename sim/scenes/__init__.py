"""Kinds of scenes: each is built from a seed and a specification with difficulty knobs."""

from typing import Annotated

from pydantic import Field

from .city import CitySpec

AnyScene = Annotated[CitySpec, Field(discriminator="kind")]

__all__ = ["AnyScene", "CitySpec"]
