"""The base of every configuration, which is frozen, typed strictly and allows no other keys, and errors in words."""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from inspect import isabstract
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import did_you_mean, similar

LONGEST_SHOWN = 200
"""Number of characters of a wrong value that an error shows."""
EXPECTED = {
    "path_type": "a path",
    "tuple_type": "a list",
    "dict_type": "a table of keys",
    "mapping_type": "a table of keys",
    "model_type": "a table of keys",
    "greater_than": "more than {gt}",
    "greater_than_equal": "at least {ge}",
    "less_than": "less than {lt}",
    "less_than_equal": "at most {le}",
    "string_pattern_mismatch": "a text of the form {pattern}",
    "union_tag_invalid": "one of {expected_tags}",
}
"""What a value had to be, by the type of a problem and with its context, where Pydantic's words are not for TOML."""

ELSEWHERE = 0.8
"""How similar a key of another table must be to one that is unknown, by `difflib`."""


class Model(BaseModel):
    """A frozen configuration. Unknown keys are errors, and the docstrings of the fields are their help texts."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, use_attribute_docstrings=True
    )


def changed(table: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table with changes, key by key through all its tables; one of another `kind` replaces the former one."""

    def value_of(key: str, new: Any) -> Any:
        old = table.get(key)
        if isinstance(old, Mapping) and isinstance(new, Mapping) and new.get("kind") in (None, old.get("kind")):
            return changed(old, new)
        return new

    return {**table, **{key: value_of(key, new) for key, new in changes.items()}}


@contextmanager
def explained(
    model: type[BaseModel], raises: Callable[[str], Exception], where: str = "", field: str = ""
) -> Iterator[None]:
    """Raise an error of ours for what does not fit a model in the block; see `problems`.

    Args:
        model: The model that the block validates.
        raises: Makes the error from its message.
        where: What the message begins with, as in `run.toml: `.
        field: See `problems`.
    """
    try:
        yield
    except ValidationError as error:
        raise raises(where + problems(error, model, field)) from error


def problems(error: ValidationError, model: type[BaseModel], field: str = "") -> str:
    """Return all problems in one line, each with what may have been meant, unknown keys first.

    Args:
        error: What the validation of the model found.
        model: The model. Its field of the name `field` holds the content of a file, whose keys begin below it.
        field: This name; empty where the model is the content itself.
    """
    found = error.errors()
    own = [one for one in found if not any(_is_below(other["loc"], one["loc"]) for other in found)]
    by_key: dict[str, list[Any]] = {}
    for problem in sorted(own, key=lambda one: one["type"] != "extra_forbidden"):
        by_key.setdefault(_dotted(problem, model, field), []).append(problem)
    texts = [_in_words(key, at_key, model, field) for key, at_key in by_key.items()]
    return texts[0] if len(texts) == 1 else f"{len(texts)} problems: {'; '.join(texts)}"


def shorten(value: object) -> str:
    """Return how a value is written, cut where it is too long for a line."""
    text = repr(value)
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def _is_below(loc: Sequence[object], other: Sequence[object]) -> bool:
    """Return whether a location is within another one, which is wrong for that reason alone."""
    return len(loc) > len(other) and loc[: len(other)] == other


def _in_words(key: str, found: Sequence[Any], model: type[BaseModel], field: str) -> str:
    """Return what is wrong with a key; the members of a union each have a problem of their own."""
    first, where = found[0], key or f"the {field or 'configuration'}"
    if first["type"] == "extra_forbidden":
        return f"unknown key {where!r}{_likely_keys(first, model, field)}"
    if first["type"] in ("missing", "union_tag_not_found"):
        return f"the key {where!r} is missing"
    if first["type"] in ("value_error", "json_invalid"):
        return f"{f'{where}: ' if key or field else ''}{first['msg'].removeprefix('Value error, ')}"
    wanted = " or ".join(dict.fromkeys(_expected(problem) for problem in found))
    given = first["ctx"]["tag"] if first["type"] == "union_tag_invalid" else first["input"]
    meant = similar(given, re.findall(r"'([^']*)'", wanted)) if isinstance(given, str) else ()
    return f"{where}: expected {wanted}{_got(given)}{did_you_mean(*meant)}"


def _expected(problem: Any) -> str:
    if words := EXPECTED.get(problem["type"]):
        context = problem.get("ctx", {}).items()
        return words.format(**{name: f"{value:g}" if isinstance(value, float) else value for name, value in context})
    return re.sub(r"^\w+ should (be |have )?| after validation", "", problem["msg"])


def _got(value: object) -> str:
    return f", got {shorten(value)}" if isinstance(value, str | int | float | bool | list) else ""


def _likely_keys(problem: Any, model: type[BaseModel], field: str) -> str:
    """Ask for similar keys in the same table, else anywhere."""
    table, _, wrong = _dotted(problem, model, field).rpartition(".")
    beside = {name: f"{table}.{name}".strip(".") for one in _location(problem, model)[1] for name in one.model_fields}
    content = _models(_below(model, field)) or [model]
    wrong_key = f"{table}.{wrong}".strip(".")  # A table of another kind may have it.
    everywhere = [key for one in content for key in _keys_of(one) if key != wrong_key]
    by_name = {key.rpartition(".")[2]: key for key in reversed(everywhere)}
    likely = [beside[name] for name in similar(wrong, beside)]
    return did_you_mean(*(likely or [by_name[name] for name in similar(wrong, by_name, ELSEWHERE)]))


def _keys_of(model: type[BaseModel]) -> Iterator[str]:
    """Yield all dotted keys of a model, its tables included."""
    for name, field in model.model_fields.items():
        yield name
        yield from (f"{name}.{key}" for one in _models(_members(field.annotation)) for key in _keys_of(one))


def _dotted(problem: Any, model: type[BaseModel], field: str) -> str:
    """Return the key of a problem as the file has it; empty where it is of the whole field."""
    keys = _location(problem, model)[0]
    kind = [problem["ctx"]["discriminator"].strip("'")] if problem["type"].startswith("union_tag") else []
    return ".".join((keys[1:] if keys[:1] == [field] else keys) + kind)


def _location(problem: Any, model: type[BaseModel]) -> tuple[list[str], list[type[BaseModel]]]:
    """Return the keys that lead to a problem, without members of unions that Pydantic puts between, and its tables."""
    at: list[Any] = [model]
    keys: list[str] = []
    tables = [model]
    for number, part in enumerate(problem["loc"], 1):
        tables, below = _models(at), [inner for one in at for inner in _below(one, part)]
        if below or (number == len(problem["loc"]) and problem["type"] == "extra_forbidden"):
            keys.append(str(part))
            at = below
        else:  # A member; if it is a kind of table, no other kind is meant.
            at = [one for one in tables if getattr(one.model_fields.get("kind"), "default", None) == part] or at
    return keys, tables


def _below(annotation: Any, key: str | int) -> list[Any]:
    """Return what a key of a table or an entry of a list may hold; nothing if there is none of that kind."""
    if fields := getattr(annotation, "model_fields", {}):
        return _members(fields[key].annotation) if key in fields else []
    origin, inner = get_origin(annotation), get_args(annotation)
    if not isinstance(origin, type):
        return []
    if issubclass(origin, Mapping):
        return _members(inner[1])
    return [member for one in inner for member in _members(one)] if isinstance(key, int) else []


def _members(annotation: Any) -> list[Any]:
    """Return the members of a union, or the kinds of an abstract table; else the annotation alone."""
    if isabstract(annotation):
        return [member for kind in annotation.__subclasses__() for member in _members(kind)]
    origin, inner = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return _members(inner[0])
    return [member for one in inner for member in _members(one)] if origin in (Union, UnionType) else [annotation]


def _models(annotations: Iterable[Any]) -> list[type[BaseModel]]:
    """Return the models among annotations and in lists of theirs."""
    inner = [member for one in annotations for member in (one, *_below(one, 0))]
    return [one for one in inner if isinstance(one, type) and issubclass(one, BaseModel)]
