"""Checksums of the files of a folder, by which a reader finds a wrong byte that no decoder notices.

The list `files.sha256` is that of `sha256sum`, which checks it, too. It is for files that are written once and that
nobody edits, such as images and tables. A file that it does not name, and a folder without it, are read as they are.
"""

from collections.abc import Mapping
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

LIST = "files.sha256"
NAMES = "utf-8", "surrogateescape"
"""How the list is decoded: names of files may be any bytes."""


class DamageError(ValueError):
    """A file is not as it was written; the message names it, and what to do."""


def digest_of(content: bytes) -> str:
    """Return the SHA-256 of the content of a file, hexadecimal."""
    return sha256(content).hexdigest()


def list_of(digests: Mapping[str, str]) -> bytes:
    """Return the content of the list of some digests, by the name of the file relative to the list, with slashes."""
    return "".join(f"{digest}  {name}\n" for name, digest in sorted(digests.items())).encode(*NAMES)


def require_whole(path: Path, content: bytes) -> None:
    """Raise a `DamageError` for the content of a file that a list beside it, or one folder above, has with another."""
    for folder in (path.parent, path.parent.parent):
        expected = _listed(folder / LIST).get(path.relative_to(folder).as_posix())
        if expected is not None and expected != digest_of(content):
            raise DamageError(
                f"{path} is damaged: it is not as {folder / LIST} has it; restore it from a copy or make it again, or "
                "delete that list if the file was changed on purpose"
            )


def _listed(path: Path) -> Mapping[str, str]:
    """Return the digests of a list, by name; empty without one."""
    try:
        stat = path.stat()
    except (OSError, ValueError):  # A path may hold a null character.
        return {}
    return _parsed(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=8)
def _parsed(path: Path, time_ns: int, size: int) -> Mapping[str, str]:
    """Return the digests of a list as it is since a time; a line of another form names nothing."""
    try:
        lines = path.read_bytes().decode(*NAMES).replace("\r", "").split("\n")
    except OSError as error:
        raise DamageError(f"cannot read {path}: {error.strerror or error}; restore it, or delete it") from error
    parted = (line.partition(" ") for line in lines)
    # Before a name is a space, or a star on Windows, and perhaps what `find .` puts there.
    return {name[1:].removeprefix("./"): digest for digest, _, name in parted}
