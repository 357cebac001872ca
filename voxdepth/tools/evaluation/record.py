"""What is kept of finished work: the description of each sequence, and the result of each method on it, a file each."""

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..files import as_tool_error
from ..results.store import Records
from .frames import Reference
from .measurements import MetricValue


@dataclass(frozen=True, kw_only=True)
class Scores:
    """What was measured of one method on one sequence."""

    measurements: tuple[MetricValue, ...] = ()
    close: tuple[tuple[int, ...], ...] = ()
    """Number of hidden pixels within 20 m that are given a close depth, by frame and tile."""
    judged: tuple[tuple[int, ...], ...] = ()
    """Number of all hidden pixels within 20 m with a reference, by frame and tile."""
    pictures: tuple[str, ...] = ()
    """The depth of one frame and perhaps its errors, see `depth_pictures`."""


@dataclass(frozen=True, kw_only=True)
class SequenceInfo:
    """The part of a sequence that methods were compared on."""

    name: str
    recording: str
    """Name of the recording, of which other sequences may evaluate other pixels."""
    frames: int
    all_frames: int
    """Number of frames that the recording has."""
    span_s: tuple[float, float]
    """Time stamps of the first and of the last of the evaluated frames [s]."""
    seed: int | None
    """Seed of a rendered sequence; None for a measured one."""
    size: str
    """Width and height of the images, such as `640x360`."""
    reference: Reference
    pixels: int
    """Number of pixels of all frames that have a reference."""
    hidden: int
    """Number of pixels of all frames that methods are to fill and are evaluated against, with and without a reference.

    Those that are known to show no surface, such as the sky, are not among them."""
    pictured: int
    """Index of the frame that is drawn: the middle one of those in which hidden pixels are evaluated."""
    far_m: float
    """Depth at the blue end of the colours of its pictures."""
    pictures: tuple[str, ...]
    """Its gray image, its reference, the depth that methods are given, and the errors of that if the truth is known."""


@dataclass(frozen=True, kw_only=True)
class MethodResult(Scores):
    """The result of one method on one sequence, as its file holds it."""

    sequence: str
    method: str
    key: dict[str, Any] = field(default_factory=dict)
    """Everything else that the measurements depend on; empty for a sequence that could not be opened."""
    info: SequenceInfo | None = None
    """Description of the sequence, which is not repeated in the file of each method; None if it could not be opened."""
    error: str | None = None
    """Why there are no measurements; None if there are."""


RECORDS = Records(MethodResult)
SEQUENCE = "[sequence]"
"""What stands in the place of a method in the one result that keeps the description of its sequence."""


def path_of(out: Path, sequence: str, method: str) -> Path:
    """Return the file of a result below the folder of all results."""
    return out / "results" / sequence / f"{method.replace(':', '-').replace('/', '-')}.json"


def load(out: Path, sequence: str, method: str, key: dict[str, Any]) -> MethodResult | None:
    """Load a finished result; None if there is none with this key. A file that cannot be read is a `ToolError`.

    Args:
        out: Folder of all results.
        sequence: Name of the sequence.
        method: Name of the method, or `SEQUENCE`.
        key: Everything else that the result depends on, see `MethodResult.key`.
    """
    path = path_of(out, sequence, method)
    with as_tool_error(f"cannot read {path}"), suppress(FileNotFoundError, ValueError):
        result = RECORDS.decode(path.read_bytes())  # It may be damaged, or of another version.
        if (result.method, result.key, result.error) == (method, key, None):
            return result
    return None


def store(out: Path, result: MethodResult) -> None:
    """Write the file of a result in one step; a failure is a `ToolError`."""
    RECORDS.write(path_of(out, result.sequence, result.method), result)
