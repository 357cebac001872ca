"""A stereo camera as TOML: `calibration.toml` of a recording."""

import tomllib
from dataclasses import fields

import tomli_w

from voxdepth.types import Intrinsics

from ..errors import RecordingError

CALIBRATION = "calibration.toml"


def calibration_toml(intrinsics: Intrinsics) -> str:
    """The fields of a stereo camera, with all digits that are needed to read them back exactly.

    Raises:
        RecordingError: The camera has no baseline.
    """
    if intrinsics.baseline_m is None:
        raise RecordingError("only a stereo camera can be recorded: expected intrinsics with a baseline_m, got none")
    kinds = {field.name: int if field.type is int else float for field in fields(intrinsics)}
    return tomli_w.dumps({name: kind(getattr(intrinsics, name)) for name, kind in kinds.items()})


def parse_calibration(text: str) -> Intrinsics:
    """The camera that `calibration_toml` wrote.

    Raises:
        RecordingError: The text is something else.
    """
    try:
        return Intrinsics(**tomllib.loads(text))
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{CALIBRATION} is damaged ({error}); restore it from a copy") from error
