"""Recordings of real sensors, as evaluations read them: each kind of their pixels is a sequence of its own."""

import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np

from ...datasets import Dataset
from ...errors import VoxDepthError
from ...types import Frame, GrayImage
from .frames import HOLES, Code, EvaluationFrame
from .later_frames import LaterFrames
from .references import Patches, References, Shadows, TrueHoles, WideShadows, mirrored, true_depths

SAME_GRAY = 3
"""Largest change of the smoothed gray value of a static pixel, where the truth is unknown."""
OpenRecording = Callable[[Path], Dataset]
"""Opens a recording."""
MakeReferences = Callable[[Dataset], References]
"""Begins to find the references of one kind of pixels in a recording."""
HELD_OUT: dict[str, MakeReferences] = {each.reference.hidden: each for each in (Shadows, WideShadows, Patches)}
"""Kinds of measured pixels that are held out, which any recording has, by the name of their mask."""


def kinds_of(folder: Path, opener: OpenRecording) -> dict[str, MakeReferences]:
    """Return the kinds of pixels that methods can be evaluated against in a recording, by the name of their mask."""
    if true_depths(folder).files:
        return HELD_OUT | {HOLES: partial(TrueHoles, folder)}
    with suppress(VoxDepthError):
        if len(opener(folder)) > 2:
            return HELD_OUT | {HOLES: LaterFrames}
    return HELD_OUT


class RecordedSource:
    """A recording of any format without true poses, of which one kind of pixels is evaluated; see `FrameSource`."""

    seed: int | None = None
    code: Code = ()

    def __init__(self, name: str, dataset: Dataset, kind: MakeReferences) -> None:
        self.name, self._dataset, self._references = name, dataset, kind(dataset)
        self.reference = self._references.reference
        self.intrinsics = mirrored(dataset.intrinsics) if self.reference.is_mirrored else dataset.intrinsics

    def __len__(self) -> int:
        return len(self._dataset)

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of the camera, the kind and all images, which are read for it."""
        total = sha256(f"{self.reference} {self.intrinsics} {self._references.digest}".encode())
        last = min(frames + self._references.later_frames, len(self._dataset))
        for frame in map(self._dataset.__getitem__, range(last)):
            crc32 = zlib.crc32(frame.depth_m.tobytes(), zlib.crc32(frame.gray.tobytes()))
            total.update(f"{frame.stamp_s} {crc32}".encode())
        return total.hexdigest()

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames with their references; a missing or damaged one is a `DatasetError`."""
        gray_before: GrayImage | None = None
        for index in range(frames):
            frame = self._dataset[index]
            images = frame.gray, *self._references.of(index, frame.depth_m)
            gray, given_m, reference_m, hidden = (self.reference.flipped(image) for image in images)
            smooth = cv2.blur(gray, (5, 5)).astype(np.uint8)
            change = cv2.absdiff(smooth, smooth if gray_before is None else gray_before)
            yield EvaluationFrame(
                frame=Frame(stamp_s=frame.stamp_s, gray=gray, depth_m=given_m),
                reference_m=reference_m,
                hidden=hidden,
                static=(change <= SAME_GRAY) & (index > 0),
            )
            gray_before = smooth
