"""Configurations in TOML files: shipped ones by name, others by path."""

import tomllib
from copy import deepcopy
from pathlib import Path
from typing import Any, TypeVar

import pydantic
import tomli_w

from sim.recording.files import replace

from .errors import ScenarioError

DATA = Path(__file__).parent / "data"

SINGULAR = {"scenarios": "scenario", "sequences": "sequence", "studies": "study"}
"""What one file of each kind is called."""

Loaded = TypeVar("Loaded", bound=pydantic.BaseModel)


def shipped_names(kind: str) -> list[str]:
    """Names of the shipped files of one kind, which is the name of their folder."""
    return sorted(path.stem for path in (DATA / kind).glob("*.toml"))


def load(model: type[Loaded], kind: str, name_or_path: str, seed: int | None, changes: dict[str, Any]) -> Loaded:
    """A configuration with its seed: a shipped file by name, a TOML file, or the `config.toml` of an earlier result.

    Args:
        model: With the fields `seed` and one that is named like the kind without its final s.
        kind: `scenarios` or `sequences`.
        name_or_path: Which one.
        seed: Master seed; None takes that of an earlier result, or 0.
        changes: Values to set, by dotted key, as in `{"mission.drones": 4}`.

    Raises:
        ScenarioError: There is no such file, or a value in it is impossible.
    """
    path, data = _read_table(kind, name_or_path)
    field = SINGULAR[kind]
    if field not in data:
        data = {field: data, "seed": 0}
    if not isinstance(data[field], dict):
        raise ScenarioError(f"{path}: {field} must be a table of keys, got {data[field]!r}")
    for key, value in changes.items():
        _set(data[field], key, value)
    if seed is not None:
        data["seed"] = seed
    return _validated(model, path, data, field)


def load_alone(model: type[Loaded], kind: str, name_or_path: str) -> tuple[Path, Loaded]:
    """A configuration that has no single seed, and where it was: a shipped file by name, or a TOML file.

    Raises:
        ScenarioError: There is no such file, or a value in it is impossible.
    """
    path, data = _read_table(kind, name_or_path)
    return path, _validated(model, path, data, SINGULAR[kind])


def to_toml(configuration: pydantic.BaseModel) -> str:
    """The resolved configuration as text that `load` reads."""
    return tomli_w.dumps(configuration.model_dump(mode="json", exclude_none=True))


def _validated(model: type[Loaded], path: Path, data: dict[str, Any], field: str) -> Loaded:
    try:
        return model.model_validate(data)
    except pydantic.ValidationError as error:
        raise ScenarioError(f"{path}: {first_problem(error, field)}") from error


def _read_table(kind: str, name_or_path: str) -> tuple[Path, dict[str, Any]]:
    path, text = _read(kind, name_or_path)
    try:
        return path, tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path} is not valid TOML: {error}") from error


def _read(kind: str, name_or_path: str) -> tuple[Path, str]:
    path = Path(name_or_path)
    if path.suffix != ".toml":
        names = shipped_names(kind)
        if name_or_path not in names:
            raise ScenarioError(
                f"there is no {SINGULAR[kind]} {name_or_path!r}; choose one of: {', '.join(names)}, "
                "or give the path of a .toml file"
            )
        path = DATA / kind / f"{name_or_path}.toml"
    try:
        return path, path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"cannot read {path}: {error}") from error


def _set(data: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for table in tables:
        data = data.setdefault(table, {})
        if not isinstance(data, dict):
            raise ScenarioError(f"{table} must be a table of keys, got {data!r}")
    data[last] = deepcopy(value)  # A later key may set something inside of it, which must not reach whoever gave it.


def first_problem(error: pydantic.ValidationError, field: str) -> str:
    """The first of the problems in one line, and how many more there are; keys as they stand in the file."""
    first, *others = sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")
    keys = first["loc"][1:] if first["loc"][:1] == (field,) else first["loc"]
    if keys[:1] in (("scene",), ("flight",)):  # Pydantic puts the kind of these into the path of their keys.
        keys = (keys[0], *keys[2:])
    where = ".".join(str(key) for key in keys) or f"the {field}"
    if first["type"] == "extra_forbidden":
        text = f"unknown key {where!r}"
    elif first["type"] == "missing":
        text = f"the key {where!r} is missing"
    else:
        got = first["input"]
        shown = f", got {got!r}" if isinstance(got, str | int | float | bool | list) else ""
        text = f"{where}: {first['msg'].removeprefix('Value error, ')}{shown}"
    return text + (f" (and {len(others)} more {'problem' if len(others) == 1 else 'problems'})" if others else "")


def write(path: Path, data: bytes) -> None:
    """Make a file and its folders, or replace it, in one step; what was finished before stays as it is.

    Raises:
        ScenarioError: It cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        replace(path, data)
    except OSError as error:
        raise ScenarioError(
            f"cannot write {path}: {error.strerror or error}; what was finished before is safe"
        ) from error
