"""Where frames come from, and what they are judged by: the truth of a recording, or pixels that were held out."""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from sim.recording import Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.metrics import SeenBefore
from voxdepth.types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, MaskImage

from ..errors import ScenarioError
from ..sequences import moving_ids
from .departures import Departures
from .groups import HELD_OUT_GROUPS, TRUE_GROUPS, Groups
from .held_out import shadows

SAME_SURFACE = 0.02
"""A pixel shows the same thing as in the frame before if its true depth changed by at most this part."""
SAME_GRAY = 3
"""The same without the truth: its smoothed gray changed by at most so many levels."""
TRUE_DEPTH = "depth_true"
"""Folder of a recording that has the truth."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Judged:
    """A frame with what its correction is judged by. Methods see `frame` alone; an oracle sees the pose as well."""

    frame: Frame
    T_world_cam: FloatArray | None
    """True pose, shape (4, 4), for oracles; None if it is not known."""
    reference_m: FloatImage
    """What depth is judged by [m], shape (H, W), float32; +inf = nothing. It is the truth, or measured."""
    labels: GrayImage
    """The group of each pixel, shape (H, W), uint8."""
    static: MaskImage
    """Pixels that show the same as in the frame before, shape (H, W): there the error should not change."""
    occluded_share: float | None
    """Part of the pixels with a reference that the second camera does not see, 0..1; None if it is not known."""
    moving: MaskImage | None = None
    """Pixels of things that move, shape (H, W); None if there are none, or if they are not known."""
    departed_m: FloatImage | None = None
    """Depth of a thing that moves where it left a pixel `departures.FRAMES_LATER` frames ago [m], shape (H, W); 0 where
    it did not. None if there are none, or if they are not known.
    """


class Frames(Protocol):
    """Frames at hand, each of which can be read again and again."""

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def __getitem__(self, index: int) -> Judged:
        """One of them, read when it is asked for."""
        ...


class Source(Protocol):
    """A sequence that methods can be compared on."""

    name: str
    intrinsics: Intrinsics
    groups: Groups
    seed: int | None
    """Of a rendered sequence; None for one that was measured, or whose maker did not say."""

    def __len__(self) -> int:
        """Number of frames."""
        ...

    def digest(self, frames: int) -> str:
        """SHA-256 of all that the first frames hold: another one means other figures."""
        ...

    def judged(self, frames: int) -> Iterator[Judged]:
        """The first frames in order, each read when it is asked for.

        Raises:
            RecordingError, DatasetError: A file of one is missing or damaged.
        """
        ...


class SimulatedSource:
    """A recording with the truth."""

    groups = TRUE_GROUPS

    def __init__(self, name: str, recording: Recording, seed: int | None) -> None:
        self.name = name
        self.intrinsics = recording.intrinsics
        self.seed = seed
        self._recording = recording
        self._moving_ids = moving_ids(recording)

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._recording)

    def digest(self, frames: int) -> str:
        """SHA-256 of all files of the first frames."""
        return self._recording.digest(frames)

    def judged(self, frames: int) -> Iterator[Judged]:
        """The frames with the truth, with the holes told apart by what was seen before, and with what moves."""
        seen_before, departures = SeenBefore(self.intrinsics), Departures()
        before: Capture | None = None
        for index in range(frames):
            capture = self._recording[index]
            judged = _judged(capture, before, seen_before)
            yield _with_movers(judged, capture, self._moving_ids, departures) if self._moving_ids else judged
            before = capture


class HeldOutSource:
    """A recording without the truth: what is taken away from the methods is what they are judged by."""

    groups = HELD_OUT_GROUPS
    seed: int | None = None

    def __init__(self, name: str, dataset: Dataset) -> None:
        self.name = name
        self.intrinsics = dataset.intrinsics
        self._dataset = dataset

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._dataset)

    def digest(self, frames: int) -> str:
        """Of the camera and of the images of all frames, which are read for it."""
        total = sha256(repr(self.intrinsics).encode())
        for index in range(frames):
            frame = self._dataset[index]
            crc32 = zlib.crc32(frame.depth_m.tobytes(), zlib.crc32(frame.gray.tobytes()))
            total.update(f"{frame.stamp_s} {crc32}".encode())
        return total.hexdigest()

    def judged(self, frames: int) -> Iterator[Judged]:
        """The frames without the pixels that are held out."""
        gray_before: GrayImage | None = None
        for index in range(frames):
            frame = self._dataset[index]
            gray = cv2.blur(frame.gray, (5, 5)).astype(np.uint8)
            yield _held_out(frame, shadows(frame.depth_m, self.intrinsics), _unmoved(gray, gray_before))
            gray_before = gray


def open_source(folder: Path) -> Source:
    """The sequence in a folder of any format; with the truth if it is a recording that has it.

    Raises:
        ScenarioError: The folder has no name of its own.
        RecordingError, DatasetError: It holds nothing that can be read.
    """
    name = folder.resolve().name
    if not name:
        raise ScenarioError(f"--data must name the folder of a sequence, got {folder}")
    if (folder / TRUE_DEPTH).is_dir():
        return SimulatedSource(name, Recording.open(folder), None)
    return HeldOutSource(name, open_dataset(folder))


def _judged(capture: Capture, before: Capture | None, seen_before: SeenBefore) -> Judged:
    truth_m = capture.depth_true_m
    known = np.isfinite(truth_m)
    hole = (capture.depth_raw_m == 0) & known
    seen, never = seen_before.split(hole, truth_m, capture.T_world_cam, capture.depth_raw_m)
    kind = capture.occluded + np.uint8(2) * seen + np.uint8(4) * never
    return Judged(
        frame=frame_of(capture),
        T_world_cam=capture.T_world_cam,
        reference_m=truth_m,
        labels=TRUE_GROUPS.label(truth_m, kind.astype(np.uint8)),
        static=_same_surface(capture, before),
        occluded_share=float((capture.occluded & known).sum() / max(1, known.sum())),
    )


def _with_movers(judged: Judged, capture: Capture, moving_ids: range, departures: Departures) -> Judged:
    moving: MaskImage = np.isin(capture.segment_id, moving_ids)
    departed_m = departures.add(moving, capture.depth_true_m)
    return replace(judged, static=judged.static & ~moving, moving=moving, departed_m=departed_m)


def _same_surface(capture: Capture, before: Capture | None) -> MaskImage:
    truth_m = capture.depth_true_m
    if before is None:
        return np.zeros(truth_m.shape, np.bool_)
    with np.errstate(invalid="ignore"):
        change_m = np.abs(truth_m - before.depth_true_m)
        close = change_m <= np.float32(SAME_SURFACE) * truth_m
    same: MaskImage = close & np.isfinite(truth_m) & (capture.segment_id == before.segment_id)
    return same


def _unmoved(gray: GrayImage, before: GrayImage | None) -> MaskImage:
    if before is None:
        return np.zeros(gray.shape, np.bool_)
    unmoved: MaskImage = cv2.absdiff(gray, before) <= SAME_GRAY
    return unmoved


def _held_out(frame: Frame, taken: MaskImage, unmoved: MaskImage) -> Judged:
    reference_m = np.where(frame.depth_m > 0, frame.depth_m, np.float32(np.inf))
    shown_m = np.where(taken, np.float32(0), frame.depth_m)
    return Judged(
        frame=Frame(stamp_s=frame.stamp_s, gray=frame.gray, depth_m=shown_m),
        T_world_cam=None,
        reference_m=reference_m,
        labels=HELD_OUT_GROUPS.label(reference_m, taken.astype(np.uint8)),
        static=unmoved,
        occluded_share=None,
    )
