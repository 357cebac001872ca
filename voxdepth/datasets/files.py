"""Reading of folders, lists, calibrations and paths. A `DatasetError` names the file that is damaged, and its fault."""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import MISSING, asdict, fields, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from ..checksums import DamageError, require_whole
from ..errors import DatasetError, FrameError, did_you_mean, similar
from ..text import decoded, parsed_toml
from ..types import Intrinsics
from ..units import Unit

CALIBRATION = "calibration.toml"
"""Fields of `Intrinsics` as TOML: `fx_px = 525.0`, ..., `width_px = 640`; `baseline_m` and
`disparity_scale` may be left out, or stand alone where the format knows the others."""
OPTIONAL = {field.name for field in fields(Intrinsics) if field.default is not MISSING}
"""Fields that may be left out."""
UNITS_PER_M = "units_per_m"
"""Key of the steps of a metre in the depth, which a `calibration.toml` may state, too."""
WANTED = {
    "fx_px": "focal length along x [px]",
    "fy_px": "focal length along y [px]",
    "cx_px": "column of the principal point [px], near half of the width",
    "cy_px": "row of the principal point [px], near half of the height",
    "width_px": "width of the images [px]",
    "height_px": "height of the images [px]",
}
"""Fields that may not, and what they are."""
LONGEST_REASON = 300
"""Number of characters of an error that quotes a value of a file."""
LARGEST_FILE_BYTES = 2**28
"""Larger files are no images or lists of one camera."""


def require_dataset(path: Path, suffixes: Collection[str]) -> None:
    """Raise a `DatasetError` for anything but a folder or a file of some suffixes."""
    try:
        if path.is_dir() or (path.is_file() and path.suffix in suffixes):
            return
        found = f"{path} is a file" if path.exists() else f"there is no folder {path}{broken_links([path])}"
    except (OSError, ValueError) as error:
        found = f"cannot look into {path} ({error})"
    raise DatasetError(
        f"{found}; name the folder that the dataset was unpacked or exported to, or a bag ({', '.join(suffixes)})"
    )


def list_folder(folder: Path) -> list[Path]:
    """Return the content of a folder, sorted by name; empty if there is no such folder."""
    try:
        return sorted(folder.iterdir()) if folder.is_dir() else []
    except OSError as error:
        raise DatasetError(f"cannot list {folder}: {error.strerror or error}; check its permissions") from error


def list_images(folder: Path, suffixes: Collection[str]) -> list[Path]:
    """Return the files of a folder that end in one of some suffixes, given in lower case; sorted by name."""
    return [path for path in list_folder(folder) if path.suffix.lower() in suffixes and not path.name.startswith(".")]


def broken_links(paths: Iterable[Path]) -> str:
    """Name the links among some paths and their folders that lead nowhere, as the end of an error; empty without."""
    links = {link for path in paths for link in (path, path.parent) if link.is_symlink() and not link.exists()}
    return "".join(f"; {link} is a link to {link.readlink()}, which is not there" for link in sorted(links))


def read_bytes(path: Path) -> bytes:
    """Read a whole plain file of a reasonable size, which is as a list of checksums has it, if one does."""
    try:
        if not path.is_file():
            found = "something else" if path.exists() else "none"
            raise DatasetError(f"expected a file {path}, got {found}{broken_links([path])}; restore it")
        size = path.stat().st_size
        if size > LARGEST_FILE_BYTES:
            raise DatasetError(f"expected at most {LARGEST_FILE_BYTES} bytes in {path}, got {size}; it is no such file")
        content = path.read_bytes()
        require_whole(path, content)
        return content
    except DamageError as error:
        raise DatasetError(str(error)) from error
    except (OSError, ValueError) as error:
        raise DatasetError(f"cannot read {path}: {getattr(error, 'strerror', None) or error}; restore it") from error


def read_text(path: Path, *, has_names: bool = False) -> str:
    """Read a text file, see `decoded`."""
    try:
        return decoded(read_bytes(path), has_names=has_names)
    except ValueError as error:
        raise DatasetError(f"expected text in {path}: {error}") from error


def path_inside(folder: Path, name: str, source: str) -> Path:
    """Return the file that a list names relative to its folder, in which it must lie, without `..`; follows links.

    The source, which errors name, is the list and the line.
    """
    parts = (PurePosixPath(name), PureWindowsPath(name))
    if any(part.is_absolute() or part.drive or ".." in part.parts for part in parts):
        raise DatasetError(
            f"{source} names {name!r}, which lies outside of {folder}; name files below the folder, relative to it"
        )
    return folder / name


def calibration_path(dataset: Path) -> Path:
    """Return where the camera of a folder or of a bag may be given."""
    return (dataset if dataset.is_dir() else dataset.parent) / CALIBRATION


def read_calibration(dataset: Path) -> dict[str, object]:
    """Return what the `calibration.toml` beside a dataset states; empty without one."""
    path = calibration_path(dataset)
    if not path.exists():
        return {}
    try:
        return parsed_toml(read_bytes(path))
    except ValueError as error:
        raise DatasetError(f"{path} is no TOML ({error}); write the fields of Intrinsics into it") from error


def choose_intrinsics(
    folder: Path, given: Intrinsics | None, of_format: Callable[[], Intrinsics], baseline_m: float | None = None
) -> Intrinsics:
    """Return the given intrinsics, else those of a folder's `calibration.toml`, else those that `of_format` returns.

    A file that has no more than the fields that may be left out, as the baseline, adds them to those of the format.

    Args:
        folder: The folder, or the file of a bag beside which the file lies.
        given: Those of the caller; None without.
        of_format: Those that the format defines or describes; it may raise a `DatasetError`.
        baseline_m: Baseline of the caller, which counts before that of all these [m]; None without.
    """
    if baseline_m is not None:
        return replace(choose_intrinsics(folder, given, of_format), baseline_m=baseline_m)
    if given is not None:
        return given
    path = calibration_path(folder)
    if not path.exists():
        return of_format()
    values, found = read_calibration(folder), []
    values.pop(UNITS_PER_M, None)
    if values.keys() <= OPTIONAL:
        try:
            values = {**given_fields(of_format()), **values}
        except DatasetError as error:  # Told below, with what is missing.
            found.append(str(error))
    return intrinsics_from(values, path, found)


def no_camera(reason: str, dataset: Path, shape: tuple[int, int] | None = None) -> DatasetError:
    """Return the error that nothing tells a dataset's camera; lines that would are a note, with the shape (H, W)."""
    keys = ", ".join(WANTED)
    error = DatasetError(f"{reason}; write {calibration_path(dataset)} with {keys} and perhaps baseline_m")
    _note_lines(error, WANTED, shape)
    return error


def _note_lines(error: DatasetError, names: Iterable[str], shape: tuple[int, int] | None = None) -> None:
    """Add lines for some fields to an error, which are to be pasted and completed."""
    known = {} if shape is None else {"height_px": shape[0], "width_px": shape[1]}
    for name in names:
        value = known.get(name, 0 if name in ("width_px", "height_px") else "nan")
        error.add_note(f"{name} = {value}  # {WANTED[name]}")


def choose_unit(dataset: Path, given: float | None, of_format: Unit) -> Unit:
    """Return the given unit of the depth, else that of a `calibration.toml` beside a dataset, else the format's.

    Raises:
        FrameError: The given number makes no sense.
        DatasetError: That of the file does not.
    """
    if given is not None:
        return Unit(given)
    value = read_calibration(dataset).get(UNITS_PER_M)
    try:
        return of_format if value is None else Unit(value)  # type: ignore[arg-type]
    except FrameError as error:
        raise DatasetError(f"{calibration_path(dataset)}: {error}") from error


def given_fields(intrinsics: Intrinsics) -> dict[str, int | float]:
    """Return the fields that are not None, by name."""
    return {name: value for name, value in asdict(intrinsics).items() if value is not None}


def intrinsics_from(values: Mapping[str, object], path: Path, found: Iterable[str] = ()) -> Intrinsics:
    """Return the intrinsics of the fields that the file `path` gives; those that have a default may be left out.

    A `DatasetError` tells all unknown and missing keys at once, with the missing lines as a note, after what was found
    before; else what is wrong with the first number that makes no sense.
    """
    kinds = {field.name: field.type for field in fields(Intrinsics)}
    known = (*kinds, UNITS_PER_M)
    unknown = [name for name in values if name not in kinds]
    found = [*found, *(f"unknown key {name!r}{did_you_mean(*similar(name, known))}" for name in unknown)]
    if missing := [name for name in WANTED if name not in values]:
        found.append(f"it lacks {', '.join(missing)}: add these lines with the values of your camera")
    if found:
        error = DatasetError(f"{path}: {'; '.join(found)}")
        _note_lines(error, missing)
        raise error
    numbers: dict[str, Any] = dict(values)
    try:
        for name, value in numbers.items():
            if type(value) is int and kinds[name] is not int:
                numbers[name] = float(value)
        return Intrinsics(**numbers)
    except (FrameError, OverflowError, RecursionError) as error:
        raise DatasetError(f"{path} describes no camera: {str(error)[:LONGEST_REASON]}") from error
