"""Files: TOML, and atomic writing."""

import os
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pydantic
import tomli_w

from .errors import ToolError

DEEPEST = 50
"""Levels of tables and arrays that a TOML file may have."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; one that cannot be read, or is not valid TOML, is a `ToolError`."""
    try:
        if path.exists() and not path.is_file():
            raise ToolError(f"{path} is no file: name a TOML file")
        text = path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:  # A path may hold a null character, and a file bytes that are no text.
        raise ToolError(f"cannot read {path}: {error}") from error
    try:
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # Numbers may be too long, and arrays too deep.
        raise ToolError(f"{path} is not valid TOML: {error}") from error
    if _is_deep(content):
        raise ToolError(f"{path} nests tables and arrays more than {DEEPEST} deep: no file of ours does")
    return content


def _is_deep(content: object) -> bool:
    """Whether there is more than `DEEPEST` levels of tables and arrays, on which functions that recurse would fail."""
    level = [content]
    for _ in range(DEEPEST + 1):
        containers = [value for value in level if isinstance(value, dict | list)]
        level = [below for one in containers for below in (one.values() if isinstance(one, dict) else one)]
    return bool(level)


def to_toml(configuration: pydantic.BaseModel) -> str:
    """Return the resolved configuration as TOML."""
    return tomli_w.dumps(configuration.model_dump(mode="json", exclude_none=True))


@contextmanager
def as_tool_error(what: str) -> Iterator[None]:
    """Turn an error of the operating system in the block into a `ToolError` that begins with `what`."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{what}: {error.strerror or error}") from error


@contextmanager
def _parents(path: Path) -> Iterator[None]:
    """Make the missing parent folders of a path; after an error, remove those that are empty."""
    missing = [parent for parent in path.parents if not parent.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        with suppress(OSError):
            for parent in missing:
                parent.rmdir()
        raise


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` that is renamed to `path` when the block ends without an error.

    The block makes a file or a folder there, and it appears as a whole or not at all. A file replaces an existing file;
    a folder replaces only an empty folder. Missing parent folders are made, and do not stay after an error. An
    `OSError` becomes a `ToolError`.
    """
    with (
        as_tool_error(f"cannot write {path}"),
        _parents(path),
        TemporaryDirectory(dir=path.parent, prefix=f".{path.name}-") as holder,
    ):
        temporary = Path(holder) / path.name
        yield temporary
        temporary.replace(path)


def write(path: Path, data: bytes) -> None:
    """Make or replace a file that survives a loss of power, and make its missing parent folders; see `atomic`."""
    with atomic(path) as temporary, temporary.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())
    if os.name == "posix":  # Other systems do not open folders.
        with as_tool_error(f"cannot write {path}"):
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
