"""Intrinsics of a dataset: those of the caller, else of `calibration.toml` in its folder, else of its format."""

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


def choose_intrinsics(folder: Path, given: Intrinsics | None, of_format: Callable[[], Intrinsics]) -> Intrinsics:
    """The given intrinsics, else those of a `calibration.toml` in the folder, else those that `of_format` returns.

    Raises:
        DatasetError: The file is damaged, or describes no camera.
    """
    path = folder / CALIBRATION
    if given is not None:
        return given
    return parse_calibration(read_text(path), path) if path.exists() else of_format()


def parse_calibration(text: str, path: Path) -> Intrinsics:
    """The intrinsics in a `calibration.toml`.

    Raises:
        DatasetError: The text is not of this form.
    """
    try:
        values = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is no TOML ({error}); write the fields of Intrinsics into it") from error
    return intrinsics_from(values, path)


def intrinsics_from(values: Mapping[str, object], path: Path) -> Intrinsics:
    """Intrinsics of the fields that the file `path` gives; only the baseline may be left out.

    Raises:
        DatasetError: A field is missing, unknown or not a suitable number.
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
    """A value of a file as a finite number; None if it is none."""
    if not isinstance(value, int | float) or isinstance(value, bool):
        return None
    try:
        return float(value) if isfinite(value) else None
    except OverflowError:
        return None
