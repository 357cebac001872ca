"""The folder of a correction: what is in it, which frames of it are finished, and who may write there."""

import fcntl
import json
import os
import tomllib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt
import pydantic

from sim.recording.files import TEMPORARY, extend, replace
from voxdepth.datasets.dataset import Dataset
from voxdepth.model import Model
from voxdepth.types import CorrectedDepth, EpochEnd, FloatImage, Frame, GrayImage, Phase, RegistrationStatus, Source

from .errors import ScenarioError
from .files import to_toml

CONFIG, FRAMES, REPORT = "config.toml", "frames.jsonl", "report.json"
DEPTH, CONFIDENCE = "depth", "confidence"
"""Sub-folders, each with one PNG of every frame."""
ANEW = "correct into a new folder, or repeat what this one was begun with"


class Correction(Model):
    """All that a result depends on, but for the images themselves."""

    corrector: str
    folder: str
    """Name of the input's folder, without its path: it may be moved."""
    format: str
    intrinsics: dict[str, int | float]
    versions: dict[str, str]
    config: dict[str, Any] | None = None
    """Resolved configuration of the corrector; None for those that have none."""


class FrameLine(Model):
    """A finished frame: its line in `frames.jsonl`."""

    name: str
    stamp_s: float
    input_crc32: int
    """Of the gray image and the raw depth."""
    files_crc32: dict[str, int]
    """Of the PNGs, by sub-folder."""
    raw_pixels: int
    """Pixels that the sensor had a depth for."""
    pixels: dict[str, int]
    """Pixels of the corrected depth, by source."""
    phase: Phase
    registration: RegistrationStatus
    epoch_end: EpochEnd | None
    wall_s: dict[str, float]
    """Time of each step."""


class CorrectedFolder:
    """The folder of a correction. It is locked: one process at a time may write there. Made by `open`."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.lines: list[FrameLine] = []
        """The finished frames."""
        self._locked = -1
        """File descriptor of the folder while it is locked."""

    @classmethod
    def open(cls, folder: Path, correction: Correction, dataset: Dataset) -> Self:
        """Start a correction in a folder, or take up the one that is there.

        Args:
            folder: Made if it does not exist.
            correction: What is to be done.
            dataset: The input.

        Raises:
            ScenarioError: There is something else, it is in use, or it cannot be written.
        """
        if folder.exists() and not folder.is_dir():
            raise ScenarioError(f"cannot write {folder}: expected a folder, or a name for a new one, got a file")
        output = cls(folder)
        try:
            with output._writing(folder):
                folder.mkdir(parents=True, exist_ok=True)
                output._lock()
                output._begin(correction, dataset)
        except BaseException:
            output.close()
            raise
        return output

    def is_finished(self, frames: int) -> bool:
        """Whether there is nothing left to do for that many frames."""
        return len(self.lines) >= frames and (self.folder / REPORT).is_file()

    def unfinish(self) -> None:
        """Take the report away: it speaks of fewer frames than there will be."""
        with self._writing(self.folder / REPORT):
            (self.folder / REPORT).unlink(missing_ok=True)

    def add(self, name: str, frame: Frame, corrected: CorrectedDepth) -> None:
        """Write the images of the next frame, and then its line."""
        images = {DEPTH: encode(to_millimetres(corrected.depth_m)), CONFIDENCE: encode(to_gray(corrected.confidence))}
        for kind, png in images.items():
            self._replace(f"{kind}/{name}.png", png)
        line = _line(name, frame, corrected, {kind: zlib.crc32(png) for kind, png in images.items()})
        with self._writing(self.folder / FRAMES):
            extend(self.folder / FRAMES, f"{line.model_dump_json()}\n".encode())
        self.lines.append(line)

    def finish(self, report: dict[str, Any]) -> None:
        """Write the report, which comes last."""
        self._replace(REPORT, (json.dumps(report, indent=2, allow_nan=False) + "\n").encode())

    def close(self) -> None:
        """Let others write here."""
        if self._locked >= 0:
            os.close(self._locked)
            self._locked = -1

    def _lock(self) -> None:
        self._locked = os.open(self.folder, os.O_RDONLY)
        try:
            fcntl.flock(self._locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ScenarioError(f"another process is correcting into {self.folder}: wait until it ends") from error

    def _begin(self, correction: Correction, dataset: Dataset) -> None:
        if not self._is_untouched():
            _require_same(self.folder, correction)
        else:
            self._replace(CONFIG, to_toml(correction).encode())
        for kind in (DEPTH, CONFIDENCE):
            (self.folder / kind).mkdir(exist_ok=True)
        self._read_lines(dataset)
        self._drop_debris(dataset)

    def _is_untouched(self) -> bool:
        """Whether the folder holds nothing, or what a correction left that did not finish a single frame."""
        names = {path.name for path in self.folder.iterdir()} - {CONFIG + TEMPORARY}
        begun = CONFIG in names and names <= {CONFIG, FRAMES, DEPTH, CONFIDENCE} and _correction_in(self.folder)
        return not names or (bool(begun) and not self._text_of_frames())

    def _text_of_frames(self) -> bytes:
        path = self.folder / FRAMES
        return path.read_bytes() if path.exists() else b""

    def _read_lines(self, dataset: Dataset) -> None:
        """Take the finished frames up to the first line that is cut short or whose files are not whole."""
        text = self._text_of_frames()
        kept = []
        for data in text.split(b"\n")[:-1]:
            line = _parsed(data)
            if line is None or not self._has_files(line):
                break
            index = len(self.lines)
            if index >= len(dataset) or dataset.name(index) != line.name:
                raise ScenarioError(f"{self.folder} has a frame {line.name} where the input has none: {ANEW}")
            self.lines.append(line)
            kept.append(data + b"\n")
        if (whole := b"".join(kept)) != text:
            self._replace(FRAMES, whole)

    def _has_files(self, line: FrameLine) -> bool:
        paths = {self.folder / kind / f"{line.name}.png": crc32 for kind, crc32 in line.files_crc32.items()}
        return all(path.is_file() and zlib.crc32(path.read_bytes()) == crc32 for path, crc32 in paths.items())

    def _drop_debris(self, dataset: Dataset) -> None:
        """Delete the images of frames that are not finished."""
        for name in map(dataset.name, range(len(self.lines), len(dataset))):
            for kind in (DEPTH, CONFIDENCE):
                for suffix in (".png", f".png{TEMPORARY}"):
                    (self.folder / kind / (name + suffix)).unlink(missing_ok=True)

    def _replace(self, name: str, data: bytes) -> None:
        with self._writing(self.folder / name):
            replace(self.folder / name, data)

    @contextmanager
    def _writing(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ScenarioError(
                f"cannot write {path}: {error.strerror or error}; {len(self.lines)} finished frames are safe in "
                f"{self.folder}"
            ) from error


def to_millimetres(depth_m: FloatImage) -> npt.NDArray[np.uint16]:
    """Depth in millimetres, shape (H, W): 0 where invalid, 65535 for all that is farther than 65.535 m."""
    return np.where(depth_m > 0, np.rint(np.clip(depth_m, 0.001, 65.535) * 1000), 0).astype(np.uint16)


def to_gray(confidence: FloatImage) -> GrayImage:
    """Confidence in 0..255, shape (H, W)."""
    gray: GrayImage = np.rint(confidence * 255).astype(np.uint8)
    return gray


def encode(image: npt.NDArray[Any]) -> bytes:
    """A PNG. Depth comes in steps, which pack best unfiltered, in half the time that OpenCV's own choice takes."""
    options = (cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE)
    return cv2.imencode(".png", image, options)[1].tobytes()


def _line(name: str, frame: Frame, corrected: CorrectedDepth, files_crc32: dict[str, int]) -> FrameLine:
    return FrameLine(
        name=name,
        stamp_s=frame.stamp_s,
        input_crc32=crc32_of(frame),
        files_crc32=files_crc32,
        raw_pixels=int(np.count_nonzero(frame.depth_m)),
        pixels={source.name.lower(): int(np.count_nonzero(corrected.source == source)) for source in Source},
        phase=corrected.phase,
        registration=corrected.registration.status,
        epoch_end=corrected.epoch_end,
        wall_s=dict(corrected.timings_s),
    )


def _parsed(line: bytes) -> FrameLine | None:
    try:
        return FrameLine.model_validate_json(line)
    except pydantic.ValidationError:
        return None


def crc32_of(frame: Frame) -> int:
    """A checksum of the images of a frame."""
    return zlib.crc32(frame.depth_m.tobytes(), zlib.crc32(frame.gray.tobytes()))


def _correction_in(folder: Path) -> dict[str, Any] | None:
    """What a folder was begun with, as written there; None if it holds no correction."""
    try:
        there = tomllib.loads((folder / CONFIG).read_text(encoding="utf-8"))
        Correction.model_validate(there)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, pydantic.ValidationError):
        return None
    return there


def _require_same(folder: Path, here: Correction) -> None:
    """Refuse a folder of another correction, or of something else."""
    there = _correction_in(folder)
    if there is None:
        raise ScenarioError(f"{folder} is not empty and holds no correction: name a new folder")
    was, now = _flat(there), _flat(tomllib.loads(to_toml(here)))
    for key in [*now, *was]:
        if was.get(key) != now.get(key):
            raise ScenarioError(
                f"{folder} was begun with {key} {was.get(key, 'not set')!r}, not {now.get(key, 'not set')!r}: {ANEW}"
            )


def _flat(tables: dict[str, Any], before: str = "") -> dict[str, Any]:
    """The values by dotted key."""
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        flat |= _flat(value, f"{before}{key}.") if isinstance(value, dict) else {before + key: value}
    return flat
