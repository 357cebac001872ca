"""Files: TOML, atomic writing, and folders that one process at a time writes to."""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import tomli_w

from ..text import parsed_toml
from .errors import ToolError

if TYPE_CHECKING:
    from pydantic import BaseModel

LOCK = "write.lock"
"""File on which `locked` holds its lock; it stays empty."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file; one that cannot be read, or is not valid TOML, is a `ToolError`."""
    try:
        if path.exists() and not path.is_file():
            raise ToolError(f"{path} is no file: name a TOML file")
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # A path may hold a null character.
        raise ToolError(f"cannot read {path}: {error}") from error
    try:
        return parsed_toml(data)
    except ValueError as error:
        raise ToolError(f"{path} is not valid TOML: {error}") from error


def to_toml(configuration: "BaseModel") -> str:
    """Return the resolved configuration as TOML."""
    return tomli_w.dumps(_values(configuration))


def require_end(path: Path, content: Mapping[str, Any], resolved: "BaseModel") -> None:
    """Raise a `ToolError` for the configuration of a result that was cut short; one that was edited is taken.

    `to_toml` writes all keys. A file that was cut lacks the last one, and defaults would count for it in silence.

    Args:
        path: The file, for the error.
        content: The configuration as the file has it.
        resolved: What it was read as.
    """
    expected, found, keys = _values(resolved), content, []
    while isinstance(expected, Mapping) and expected:
        tables = [key for key, value in expected.items() if isinstance(value, Mapping)]
        keys.append((tables or list(expected))[-1])  # Tables come last.
        if not isinstance(found, Mapping) or keys[-1] not in found:
            raise ToolError(
                f"{path} was cut short: it lacks its last key, {'.'.join(keys)}; restore it from a copy, or add that"
            )
        expected, found = expected[keys[-1]], found[keys[-1]]


def _values(configuration: "BaseModel") -> dict[str, Any]:
    return configuration.model_dump(mode="json", exclude_none=True)


@contextmanager
def as_tool_error(what: str) -> Iterator[None]:
    """Turn an error of the operating system in the block into a `ToolError` that begins with `what`."""
    try:
        yield
    except OSError as error:
        raise ToolError(f"{what}: {error.strerror or error}") from error


def resolved(path: Path) -> Path:
    """Return the absolute path without symbolic links; a loop of them is no error."""
    return Path(os.path.realpath(path))


@contextmanager
def atomic(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path` that is renamed to `path` when the block ends without an error.

    The block makes a file or a folder there, and it appears as a whole or not at all. A file replaces an existing file;
    a folder replaces only an empty folder. Missing parent folders are made. An `OSError` becomes a `ToolError`.
    """
    with as_tool_error(f"cannot write {path}"):
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=path.parent, prefix=f".{path.name}-") as holder:
            temporary = Path(holder) / path.name
            yield temporary
            if temporary.is_dir() and path.is_dir():
                if any(path.iterdir()):  # Another process may have been faster.
                    raise ToolError(f"{path} has files by now, which nothing replaces: name another folder")
                path.rmdir()  # Windows replaces no folder, be it empty.
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


@contextmanager
def locked(folder: Path, busy: str) -> Iterator[None]:
    """Make a folder and hold its write lock, which the system releases when the process ends in any way.

    The lock is on a file of its own that is open for writing, as network file systems require. A lock that another
    process holds is a `ToolError` with the message `busy`; an unwritable folder is one, too.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / LOCK).open("ab")
    except OSError as error:
        raise ToolError(f"cannot write to {folder}: {error.strerror}; choose a writable folder") from error
    with file:
        try:
            _lock(file.fileno())
        except BlockingIOError as error:
            raise ToolError(busy) from error
        except OSError as error:
            raise ToolError(f"cannot lock {folder}: {error.strerror}; choose a folder on another disk") from error
        yield


def _lock(descriptor: int) -> None:
    """Lock an open file; a `BlockingIOError` if another process did."""
    if sys.platform == "win32":
        import msvcrt

        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except PermissionError as error:
            raise BlockingIOError(*error.args) from error
    else:
        import fcntl

        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
