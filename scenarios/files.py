"""Configurations in TOML, shipped ones by name and others by path."""

from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path
from typing import Annotated, Any, TypeVar

import pydantic

from voxdepth.errors import no_such
from voxdepth.model import explained, problems, shorten
from voxdepth.tools.files import read_toml, require_end

from .errors import ScenarioError

DATA = Path(__file__).parent / "data"

SINGULAR = {"scenarios": "scenario", "sequences": "sequence", "studies": "study"}
"""Name of a single file of each kind."""

Name = Annotated[str, pydantic.Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9,._ -]{0,79}$")]
"""A name of a scenario, a sequence, a study or an arm. It becomes a part of a path, and cannot lead out of a folder."""

Loaded = TypeVar("Loaded", bound=pydantic.BaseModel)


def shipped_names(kind: str) -> list[str]:
    """Return the names of the shipped files of one kind; a kind is the name of a folder of `data`."""
    return sorted(path.stem for path in (DATA / kind).glob("*.toml"))


def load(model: type[Loaded], kind: str, name_or_path: str, seed: int | None, changes: Mapping[str, Any]) -> Loaded:
    """Load a configuration with its seed; a file that is missing or invalid is a `ToolError`.

    Args:
        model: Its fields are `seed` and the singular of the kind.
        kind: `scenarios` or `sequences`.
        name_or_path: Name of a shipped file, or path of a TOML file, which may be the `config.toml` of a result.
        seed: Master seed; None takes the seed of the result, or 0.
        changes: Values to set, by dotted key, as in `{"mission.drones": 4}`.
    """
    path, data = _read_table(kind, name_or_path)
    field = SINGULAR[kind]
    if not (is_of_result := field in data):
        data = {field: data, "seed": 0}
    if not isinstance(data[field], dict):
        raise ScenarioError(f"{path}: {field} must be a table of keys, got {shorten(data[field])}")
    changed = deepcopy(data)
    for key, value in changes.items():
        _set(changed[field], key, value)
    if seed is not None:
        changed["seed"] = seed
    try:
        loaded = model.model_validate(changed)
    except pydantic.ValidationError as error:
        _validated(model, path, data, field)  # An error of the file itself is reported as such.
        chosen = ", ".join(f"{key} = {shorten(value)}" for key, value in {**changes, "seed": changed["seed"]}.items())
        raise ScenarioError(f"{name_or_path} with {chosen}: {problems(error, model, field)}") from error
    if is_of_result:
        require_end(path, data, loaded)
    return loaded


def load_alone(model: type[Loaded], kind: str, name_or_path: str) -> tuple[Path, Loaded]:
    """Load a configuration without a seed, by the name of a shipped file or by path; return the path as well.

    A file that is missing or invalid is a `ToolError`.
    """
    path, data = _read_table(kind, name_or_path)
    return path, _validated(model, path, data, SINGULAR[kind])


def _validated(model: type[Loaded], path: Path, data: dict[str, Any], field: str) -> Loaded:
    with explained(model, ScenarioError, f"{path}: ", field):
        return model.model_validate(data)


def _read_table(kind: str, name_or_path: str) -> tuple[Path, dict[str, Any]]:
    path = Path(name_or_path)
    if path.suffix != ".toml":
        names = shipped_names(kind)
        if name_or_path not in names:
            raise ScenarioError(f"{no_such(SINGULAR[kind], name_or_path, names)}, or give the path of a .toml file")
        path = DATA / kind / f"{name_or_path}.toml"
    return path, read_toml(path)


def _set(data: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise ScenarioError(f"{table} must be a table of keys, got {shorten(data)}")
    data[last] = deepcopy(value)  # A later key may change it, which must not affect the caller's value.
