"""Reading of folders, lists and paths that may be damaged, with errors that name the file."""

from collections.abc import Collection
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..errors import DatasetError

LARGEST_FILE_BYTES = 2**28
"""Larger files are no images or lists of one camera."""


def require_folder(folder: Path) -> None:
    """Refuse anything but a folder.

    Raises:
        DatasetError: The folder is missing, or a file.
    """
    try:
        if folder.is_dir():
            return
        found = f"{folder} is a file" if folder.exists() else f"there is no folder {folder}"
    except (OSError, ValueError) as error:
        found = f"cannot look into {folder} ({error})"
    raise DatasetError(f"{found}; name the folder that the dataset was unpacked or exported to")


def list_folder(folder: Path) -> list[Path]:
    """Content of a folder, sorted by name; empty if there is no such folder.

    Raises:
        DatasetError: It cannot be read.
    """
    try:
        return sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise DatasetError(f"cannot list {folder}: {error.strerror or error}; check its permissions") from error


def list_images(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """The files of a folder that end in one of some suffixes, given in lower case; sorted by name.

    Raises:
        DatasetError: The folder cannot be read.
    """
    return [path for path in list_folder(folder) if path.suffix.lower() in suffixes and not path.name.startswith(".")]


def read_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        DatasetError: The file is missing, no plain file, unreasonably large, or cannot be read.
    """
    try:
        if not path.is_file():
            raise DatasetError(
                f"expected a file {path}, got {'something else' if path.exists() else 'none'}; restore it"
            )
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            raise DatasetError(f"expected at most {LARGEST_FILE_BYTES} bytes in {path}, got {size}; it is no such file")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise DatasetError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}; restore it") from error


def read_text(path: Path) -> str:
    """Read a text file in UTF-8.

    Raises:
        DatasetError: As for `read_bytes`, or it is not text.
    """
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"expected text in {path}, got other bytes at {error.start}; restore the file") from error
    if "\0" in text:
        raise DatasetError(f"expected text in {path}, got zero bytes; restore the file")
    return text


def path_inside(folder: Path, name: str, source: str) -> Path:
    """The file that a list names relative to its folder, below which it must lie.

    Raises:
        DatasetError: The name leads elsewhere: it is absolute, has `..` in it, or follows a link out.
    """
    parts = (PurePosixPath(name), PureWindowsPath(name))
    try:
        leads_out = any(part.is_absolute() or part.drive or ".." in part.parts for part in parts)
        if not leads_out and (folder / name).resolve().is_relative_to(folder.resolve()):
            return folder / name
    except (OSError, RuntimeError, ValueError) as error:  # A loop of links is a RuntimeError.
        raise DatasetError(f"{source} names {name!r}, which is no usable path ({error})") from error
    raise DatasetError(
        f"{source} names {name!r}, which lies outside of {folder}; name files below the folder, relative to it"
    )
