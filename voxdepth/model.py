"""The base of every configuration, which is frozen, typed strictly and allows no other keys, and errors in words."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

LONGEST_SHOWN = 200
"""Number of characters of a wrong value that an error shows."""


class Model(BaseModel):
    """A configuration whose field docstrings are its help texts."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


def first_problem(error: ValidationError, field: str) -> str:
    """Return the first problem in one line with the number of others; keys are named as in the file."""
    first, *others = _by_weight(error)
    where = first_key(error, field) or f"the {field}"
    if first["type"] == "extra_forbidden":
        text = f"unknown key {where!r}"
    elif first["type"] == "missing":
        text = f"the key {where!r} is missing"
    else:
        got = first["input"]
        shown = f", got {shorten(got)}" if isinstance(got, str | int | float | bool | list) else ""
        text = f"{where}: {first['msg'].removeprefix('Value error, ')}{shown}"
    return text + (f" (and {len(others)} more {'problem' if len(others) == 1 else 'problems'})" if others else "")


def first_key(error: ValidationError, field: str) -> str:
    """Return the dotted key of the first problem as the file has it; empty where it is of the whole field."""
    place = _by_weight(error)[0]["loc"]
    keys = place[1:] if place[:1] == (field,) else place
    if keys[:1] == ("flight",):  # Pydantic adds its kind to the path.
        keys = (keys[0], *keys[2:])
    return ".".join(str(key) for key in keys)


def _by_weight(error: ValidationError) -> list[Any]:
    """The problems, unknown keys first, which often are why others are missing."""
    return sorted(error.errors(), key=lambda problem: problem["type"] != "extra_forbidden")


def shorten(value: object) -> str:
    """Return how a value is written, cut where it is too long for a line."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."
