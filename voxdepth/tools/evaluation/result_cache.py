"""What is kept of finished work: the result of each method on each sequence."""

import base64
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pydantic
from pydantic import ConfigDict

from ...colors import picked
from ...model import Model
from ...types import FloatImage
from ..files import as_tool_error, write
from ..output import encode, to_millimetres
from .groups import ALL
from .measurements import Measurement
from .scoring import METRICS

THUMBNAIL_PX = 240
"""Largest width of the depth image that is kept of the last frame of a sequence."""


class Key(Model):
    """Everything that the measurements of a result depend on."""

    sequence: str
    method: str
    frames: int
    seed: int | None
    """Seed of a rendered sequence; None for a measured one."""
    digest: str
    """SHA-256 of the images and poses of the sequence."""
    config: dict[str, Any] | None
    """Configuration of the method; None if it has none."""
    versions: dict[str, str]
    metrics: tuple[str, ...] = tuple(METRICS)
    """Names of the metrics of errors, so that a new one is computed for finished results, too."""


class Scores(Model):
    """What was measured of one method on one sequence."""

    model_config = ConfigDict(allow_inf_nan=True, ser_json_inf_nan="constants")

    measurements: tuple[Measurement, ...] = ()
    frame_close: tuple[tuple[int, int], ...] = ()
    """Number of hidden pixels within 20 m of every frame that are given a close depth, and of all of them."""
    frame_errors_m: tuple[tuple[float, int], ...] = ()
    """Sum of the absolute errors of measured pixels within 20 m of every frame [m], and number of these pixels."""
    thumbnail: str = ""
    """Depth of the last frame, as `encoded_thumbnail` gives it."""


class SequenceInfo(Model):
    """The part of a sequence that methods were compared on."""

    name: str
    digest: str
    """SHA-256 of its images and poses."""
    frames: int
    seed: int | None
    width_px: int
    height_px: int
    focal_px: float
    baseline_m: float | None
    hidden: str
    """Mask of the pixels that methods are given no depth of."""
    independent: str
    """Mask of the pixels whose reference is not what the methods were given."""
    reference_name: str
    """What methods are scored by."""
    pixels: dict[str, dict[str, int]]
    """Number of pixels of all frames, by mask and range."""
    holes: int
    """Number of pixels of all frames that the methods were given no depth of, whether they have a reference or not."""
    reference: str = ""
    """Thumbnail of the reference depth of the last frame."""
    raw: str = ""
    """Thumbnail of the depth of the last frame that methods were given."""

    @property
    def size(self) -> str:
        """Width and height of the images, such as `640x360`."""
        return f"{self.width_px}x{self.height_px}"

    @property
    def judged_share(self) -> float:
        """Share of the pixels without depth that have a reference, which the results are about."""
        return self.pixels[self.hidden][ALL] / max(1, self.holes)


class Result(Scores):
    """The result of one method on one sequence."""

    key: Key
    info: SequenceInfo | None = None
    """Description of the sequence; None if it could not be opened."""
    error: str | None = None
    """Why there are no measurements; None if there are."""


def path_of(out: Path, key: Key) -> Path:
    """Return the file of a result below the folder of all results."""
    return out / "results" / key.sequence / f"{key.method.replace(':', '-').replace('/', '-')}.json"


def load(out: Path, key: Key) -> Result | None:
    """Load the finished result of a key; None if there is none. A file that cannot be read is a `ToolError`."""
    path = path_of(out, key)
    with as_tool_error(f"cannot read {path}"):
        if not path.exists():
            return None
        data = path.read_bytes()
    with suppress(pydantic.ValidationError):  # Damaged, or of another version.
        result = Result.model_validate_json(data)
        return result if result.key == key and result.error is None else None
    return None


def store(out: Path, result: Result) -> None:
    """Write the file of a result in one step; a failure is a `ToolError`."""
    write(path_of(out, result.key), f"{result.model_dump_json(indent=1)}\n".encode())


def encoded_thumbnail(depth_m: FloatImage) -> str:
    """Encode depth [m], shape (H, W), as a narrowed PNG with 16 bits and millimetres, in base64."""
    narrow = picked(to_millimetres(depth_m), min(THUMBNAIL_PX, depth_m.shape[1]))
    return base64.b64encode(encode(narrow)).decode()


def decoded_thumbnail(png: str) -> FloatImage:
    """Decode a thumbnail to depth [m], shape (H, W)."""
    data = np.frombuffer(base64.b64decode(png), np.uint8)
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED)).astype(np.float32) / np.float32(1000)
