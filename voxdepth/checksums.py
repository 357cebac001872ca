"""Checksums of files that are written once and read later: damage is found, whatever byte it hits.

A folder of a result has the list `files.sha256` of its files, which `sha256sum -c files.sha256` checks, too. A text
that stands alone has its digest at its end. What has none, as of an earlier version, is taken as it is.
"""

import hashlib
import json
from functools import lru_cache
from pathlib import Path
from typing import Any

LIST = "files.sha256"
COMMENT = "# sha256 "
"""How the last line of a sealed TOML file begins."""
KEY = "sha256"
"""The last key of a sealed JSON object."""


class DamageError(ValueError):
    """A file is not as it was written; the message names it, and what to do."""


def list_of(folder: Path) -> bytes:
    """Return the content of the list of all files below a folder as they are now."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path != folder / LIST)
    lines = [f"{_digest_of(path)}  {path.relative_to(folder).as_posix()}\n" for path in files]
    return "".join(lines).encode()


def require_whole(path: Path, content: bytes | None = None) -> None:
    """Raise a `DamageError` for a file that a list beside it or in the folder above has with another digest.

    Args:
        path: The file.
        content: What was read of it; None reads it here, where it is listed.
    """
    for folder in (path.parent, path.parent.parent):
        expected = _listed(folder / LIST).get(path.relative_to(folder).as_posix())
        if expected is None:
            continue
        found = _digest_of(path) if content is None else hashlib.sha256(content).hexdigest()
        if found != expected:
            raise DamageError(
                f"{path} is damaged: it is not as {folder / LIST} lists it; restore it from a copy or make it again, "
                "or delete the list if you changed the file on purpose"
            )


def sealed_toml(text: str) -> str:
    """Return a TOML text with its digest in a comment at the end."""
    return f"{text}{COMMENT}{_digest(text)}\n"


def require_sealed(text: str) -> None:
    """Raise a `DamageError` unless a TOML text has its digest at the end."""
    content, mark, digest = text.rpartition(COMMENT)
    if not mark or digest != f"{_digest(content)}\n":
        raise DamageError("it does not end with its digest")


def sealed_json(content: dict[str, Any]) -> bytes:
    """Return an object as JSON, with its digest under the last key."""
    return f"{json.dumps(content | {KEY: _digest(json.dumps(content))}, indent=1)}\n".encode()


def unsealed_json(data: bytes) -> bytes:
    """Return JSON without the digest; JSON that cannot be read, or has another digest, is a `ValueError`."""
    content = json.loads(data)
    digest = content.pop(KEY, None) if isinstance(content, dict) else None
    if digest not in (None, _digest(json.dumps(content))):
        raise DamageError(f"its content is not that of its {KEY}")
    return json.dumps(content).encode()


def _listed(path: Path) -> dict[str, str]:
    """The digests of a list by name; empty without one."""
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return {}
    return _parsed(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=8)
def _parsed(path: Path, time_ns: int, size: int) -> dict[str, str]:
    """The digests of a list as it was at a time; a line of another form lists nothing."""
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines()
    return {name: digest for digest, _, name in (line.partition("  ") for line in lines)}


def _digest_of(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
