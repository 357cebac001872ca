"""Kinds of scenes; each is built from a seed and a configuration, which sets its difficulty.

Another distribution adds a kind through the entry-point group `voxdepth.scenes`, whose entries map a kind to a subclass
of `SceneSpec` with that `kind`. Its code is loaded when a scenario names it, and it cannot replace a kind of ours.
"""

from importlib.metadata import entry_points
from typing import Annotated, Any

from pydantic import PlainValidator, SerializeAsAny, TypeAdapter
from pydantic_core import PydanticKnownError

from ..bodies import SceneSpec
from .city import CitySpec
from .corridor import CorridorSpec
from .forest import ForestSpec
from .gap import GapSpec
from .lawn import LawnSpec
from .listed import ListedSpec
from .plains import PlainsSpec
from .room import RoomSpec

ENTRY_POINTS = "voxdepth.scenes"
"""Group of the entry points by which other distributions add kinds of scenes."""
GROWN: tuple[type[SceneSpec], ...] = (CitySpec, ForestSpec, CorridorSpec, GapSpec, PlainsSpec, LawnSpec)
"""Those that grow from a seed and that drones fly through."""
OTHERS: tuple[type[SceneSpec], ...] = (RoomSpec, ListedSpec)
KINDS: dict[Any, type[SceneSpec]] = {spec.model_fields["kind"].default: spec for spec in GROWN + OTHERS}


def _spec_of(scene: Any) -> SceneSpec:
    """Return a specification, or that of a table with its `kind`."""
    if isinstance(scene, SceneSpec):
        return scene
    kind = scene.get("kind") if isinstance(scene, dict) else None
    spec = KINDS.get(kind) or _loaded(kind)
    scenes: TypeAdapter[dict[Any, SceneSpec]] = TypeAdapter(dict[Any, spec])  # type: ignore[valid-type]
    return scenes.validate_python({kind: scene})[kind]  # Errors lie below the kind, as in unions.


def _loaded(kind: Any) -> type[SceneSpec]:
    """Return the specification of a kind of another distribution."""
    if kind is None:
        raise PydanticKnownError("union_tag_not_found", {"discriminator": "'kind'"})
    others = {entry.name: entry for entry in entry_points(group=ENTRY_POINTS)}
    if kind not in others:
        known = ", ".join(map(repr, dict.fromkeys((*KINDS, *sorted(others)))))
        raise PydanticKnownError(
            "union_tag_invalid", {"discriminator": "'kind'", "tag": str(kind), "expected_tags": known}
        )
    try:
        spec: type[SceneSpec] = others[kind].load()
    except Exception as error:  # foreign code may raise anything
        origin = f"{others[kind].value!r} ({type(error).__name__}: {error})"
        raise ValueError(f"cannot load {kind!r} from {origin}: repair or uninstall what offers it") from error
    return spec


AnyScene = Annotated[SceneSpec, PlainValidator(_spec_of), SerializeAsAny()]

__all__ = [
    "AnyScene", "CitySpec", "CorridorSpec", "ForestSpec", "GapSpec", "LawnSpec", "ListedSpec", "PlainsSpec", "RoomSpec"
]  # fmt: skip
