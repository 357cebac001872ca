"""Which intrinsics a dataset is read with: those given, else `calibration.toml` in its folder, else its format's."""

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import fields
from math import isfinite
from pathlib import Path
from typing import Any

from ..errors import DatasetError, FrameError
from ..types import Intrinsics
from .files import read_text

CALIBRATION = "calibration.toml"
"""Fields of `Intrinsics` as TOML: `fx_px = 525.0`, ..., `width_px = 640`; `baseline_m` may be left out."""
_LARGEST_SIDE_PX = 2**16


def choose_intrinsics(folder: Path, given: Intrinsics | None, of_format: Callable[[], Intrinsics]) -> Intrinsics:
    """The intrinsics to read a dataset with.

    Args:
        folder: Of the dataset; a `calibration.toml` in it counts if none are given.
        given: What the caller says, which counts before everything else.
        of_format: What the format or its files say, asked last.

    Raises:
        DatasetError: The file is damaged, or the principal point is far outside the image.
    """
    path = folder / CALIBRATION
    if given is not None:
        chosen, source = given, "the given intrinsics"
    elif path.exists():
        chosen, source = parse_calibration(read_text(path), path), str(path)
    else:
        chosen, source = of_format(), f"the calibration of {folder}"
    _require_plausible(chosen, source)
    return chosen


def parse_calibration(text: str, path: Path) -> Intrinsics:
    """The intrinsics in a `calibration.toml`.

    Raises:
        DatasetError: The text is something else.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is no TOML ({error}); write the fields of Intrinsics into it") from error
    return intrinsics_from(values, path)


def intrinsics_from(values: Mapping[str, object], path: Path) -> Intrinsics:
    """Intrinsics of the numbers that a file gives.

    Args:
        values: By the names of the fields of `Intrinsics`; only the baseline may be left out.
        path: The file, for the error.

    Raises:
        DatasetError: A field is missing, unknown, or no number that can stand there.
    """
    kinds = {field.name: field.type for field in fields(Intrinsics)}
    unknown = sorted(values.keys() - kinds.keys())
    missing = sorted(kinds.keys() - values.keys() - {"baseline_m"})
    if unknown or missing:
        raise DatasetError(f"expected {', '.join(kinds)} in {path}; missing: {missing}, unknown: {unknown}")
    numbers: dict[str, Any] = {}
    for name, value in values.items():
        number = as_number(value)
        if number is None or (kinds[name] is int and type(value) is not int):
            wanted = "a whole number" if kinds[name] is int else "a finite number"
            raise DatasetError(f"expected {wanted} for {name} in {path}, got {str(value)[:80]}")
        numbers[name] = int(number) if kinds[name] is int else number
    try:
        return Intrinsics(**numbers)
    except FrameError as error:
        raise DatasetError(f"{path} describes no camera: {error}") from error


def as_number(value: object) -> float | None:
    """A finite number that a file gives; None if it is none."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:
        return None


def _require_plausible(intrinsics: Intrinsics, source: str) -> None:
    width_px, height_px = intrinsics.width_px, intrinsics.height_px
    if max(width_px, height_px) > _LARGEST_SIDE_PX:
        raise DatasetError(f"expected at most {_LARGEST_SIDE_PX} pixels a side in {source}, got {width_px}x{height_px}")
    if not all(map(isfinite, (intrinsics.fx_px, intrinsics.fy_px, intrinsics.baseline_m or 0.0))):
        raise DatasetError(f"expected finite numbers in {source}, got {intrinsics}")
    inside_x = abs(intrinsics.cx_px - width_px / 2) <= width_px
    inside_y = abs(intrinsics.cy_px - height_px / 2) <= height_px
    if not (inside_x and inside_y):
        raise DatasetError(
            f"expected a principal point near the image of {width_px}x{height_px} pixels in {source}, got "
            f"({intrinsics.cx_px}, {intrinsics.cy_px}); is the calibration of another image size?"
        )
