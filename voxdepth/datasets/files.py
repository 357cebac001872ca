"""Reading of folders, lists, calibrations and paths. A `DatasetError` names the file that is damaged, and its fault."""

import tomllib
from collections.abc import Callable, Collection, Mapping
from contextlib import suppress
from dataclasses import MISSING, asdict, fields
from math import isfinite
from pathlib import Path, PurePosixPath, PureWindowsPath
from types import MappingProxyType
from typing import Any

from ..errors import DatasetError, FrameError, did_you_mean, similar
from ..types import Intrinsics

CALIBRATION = "calibration.toml"
"""Fields of `Intrinsics` as TOML: `fx_px = 525.0`, ..., `width_px = 640`; `baseline_m` and
`disparity_scale` may be left out, or stand alone where the format knows the others."""
OPTIONAL = {field.name for field in fields(Intrinsics) if field.default is not MISSING}
"""Fields that may be left out."""
WANTED = {
    "fx_px": "focal length along x [px]",
    "fy_px": "focal length along y [px]",
    "cx_px": "column of the principal point [px], near half of the width",
    "cy_px": "row of the principal point [px], near half of the height",
    "width_px": "width of the images [px]",
    "height_px": "height of the images [px]",
}
"""Fields that may not, and what they are."""
LARGEST_FILE_BYTES = 2**28
"""Larger files are no images or lists of one camera."""


def require_dataset(path: Path, suffixes: Collection[str]) -> None:
    """Raise a `DatasetError` for anything but a folder or a file of some suffixes."""
    try:
        if path.is_dir() or (path.is_file() and path.suffix in suffixes):
            return
        found = f"{path} is a file" if path.exists() else f"there is no folder {path}"
    except (OSError, ValueError) as error:
        found = f"cannot look into {path} ({error})"
    raise DatasetError(
        f"{found}; name the folder that the dataset was unpacked or exported to, or a bag ({', '.join(suffixes)})"
    )


def list_folder(folder: Path) -> list[Path]:
    """Content of a folder, sorted by name; empty if there is no such folder."""
    try:
        return sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise DatasetError(f"cannot list {folder}: {error.strerror or error}; check its permissions") from error


def list_images(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """The files of a folder that end in one of some suffixes, given in lower case; sorted by name."""
    return [path for path in list_folder(folder) if path.suffix.lower() in suffixes and not path.name.startswith(".")]


def read_bytes(path: Path) -> bytes:
    """Read a whole plain file of a reasonable size."""
    try:
        if not path.is_file():
            found = "something else" if path.exists() else "none"
            raise DatasetError(f"expected a file {path}, got {found}; restore it")
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            raise DatasetError(f"expected at most {LARGEST_FILE_BYTES} bytes in {path}, got {size}; it is no such file")
        return path.read_bytes()
    except (OSError, ValueError) as error:
        raise DatasetError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}; restore it") from error


def read_text(path: Path) -> str:
    """Read a text file in UTF-8."""
    data = read_bytes(path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DatasetError(f"expected text in {path}, got other bytes at {error.start}; restore the file") from error
    if "\0" in text:
        raise DatasetError(f"expected text in {path}, got zero bytes; restore the file")
    return text


def path_inside(folder: Path, name: str, source: str) -> Path:
    """The file that a list names relative to its folder, below which it must lie, without `..` and links that lead out.

    The source, which errors name, is the list and the line.
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


def calibration_path(dataset: Path) -> Path:
    """Where the camera of a folder or of a bag may be stated."""
    return (dataset if dataset.is_dir() else dataset.parent) / CALIBRATION


def choose_intrinsics(folder: Path, given: Intrinsics | None, of_format: Callable[[], Intrinsics]) -> Intrinsics:
    """The given intrinsics, else those of a `calibration.toml` in the folder, else those that `of_format` returns.

    A file that has no more than the fields that may be left out, as the baseline, adds them to those of the format.
    """
    path = calibration_path(folder)
    if given is not None:
        return given
    if not path.exists():
        return of_format()
    values = _parse_fields(read_text(path), path)
    if values.keys() <= OPTIONAL:
        with suppress(DatasetError):  # What is missing is told below.
            values = {**stated(of_format()), **values}
    return intrinsics_from(values, path)


def stated(intrinsics: Intrinsics) -> dict[str, int | float]:
    """The fields that are not None, by name."""
    return {name: value for name, value in asdict(intrinsics).items() if value is not None}


def parse_calibration(text: str, path: Path, known: Mapping[str, object] = MappingProxyType({})) -> Intrinsics:
    """The intrinsics in the text of a `calibration.toml`, which may leave out fields that are known otherwise."""
    return intrinsics_from({**known, **_parse_fields(text, path)}, path)


def _parse_fields(text: str, path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is no TOML ({error}); write the fields of Intrinsics into it") from error


def intrinsics_from(values: Mapping[str, object], path: Path) -> Intrinsics:
    """Intrinsics of the fields that the file `path` gives; those that have a default may be left out.

    A `DatasetError` tells all problems at once, with the missing lines as a note.
    """
    kinds = {field.name: field.type for field in fields(Intrinsics)}
    found = [f"unknown key {name!r}{did_you_mean(*similar(name, kinds))}" for name in values if name not in kinds]
    numbers: dict[str, Any] = {}
    for name, value in ((name, value) for name, value in values.items() if name in kinds):
        number = as_number(value)
        if number is None or (kinds[name] is int and type(value) is not int):
            wanted = "a whole number" if kinds[name] is int else "a finite number"
            got = str(value)[:80] if isinstance(value, str | int | float) else f"a {type(value).__name__}"
            found.append(f"expected {wanted} for {name}, got {got}")
        else:
            numbers[name] = int(number) if kinds[name] is int else number
    if missing := [name for name in WANTED if name not in values]:
        found.append(f"it lacks {', '.join(missing)}: add these lines with the values of your camera")
    if found:
        error = DatasetError(f"{path}: {'; '.join(found)}")
        for name in missing:
            error.add_note(f"{name} = {0 if kinds[name] is int else 'nan'}  # {WANTED[name]}")
        raise error
    try:
        return Intrinsics(**numbers)
    except FrameError as error:
        raise DatasetError(f"{path} describes no camera: {error}") from error


def as_number(value: object) -> float | None:
    """A value of a file as a finite number; None if it is none."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:
        return None
