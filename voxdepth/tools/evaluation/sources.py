"""Where the frames of an evaluation come from, each with its reference."""

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from ...datasets import Dataset
from ...types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, MaskImage
from ..files import as_tool_error
from .groups import Groups
from .kinds import Kind
from .references import mirrored

SAME_GRAY = 3
"""Largest change of the smoothed gray value of a static pixel, where the truth is unknown."""
Code = Sequence[tuple[str, str]]
"""Packages and patterns of their files, see `code_digest`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationFrame:
    """A frame with its reference. Methods see only `frame`; an oracle sees the pose too."""

    frame: Frame
    T_world_cam: FloatArray | None
    """True pose, shape (4, 4), for oracles; None if it is unknown."""
    reference_m: FloatImage
    """True or measured depth [m], shape (H, W), float32; 0 = unknown, +inf = no surface."""
    labels: GrayImage
    """Pixel group of each pixel, shape (H, W), uint8."""
    static: MaskImage
    """Pixels that show the same surface as in the frame before, shape (H, W)."""
    moving: MaskImage | None = None
    """Pixels of moving objects, shape (H, W); None if there are none or they are unknown."""
    departed_m: FloatImage | None = None
    """Depth of the moving object that left a pixel some frames ago [m], shape (H, W); 0 elsewhere."""


class FrameCache:
    """Frames of one sequence in files: they are computed once for all methods, and only one is in memory.

    A megapixel takes 11 MB, or 16 MB where things move. The folder must exist.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._frames = folder, 0

    def fill(self, frames: Iterable[EvaluationFrame], progress: Callable[[int], None] = lambda count: None) -> None:
        """Write frames and pass their number to `progress`; a frame that cannot be written is a `ToolError`."""
        for index, frame in enumerate(frames):
            what = f"cannot keep frame {index} in {self._folder}"
            with as_tool_error(what):
                np.savez(self.path(index), **_arrays(frame))
            self._frames = index + 1
            progress(self._frames)

    def __len__(self) -> int:
        return self._frames

    def __getitem__(self, index: int) -> EvaluationFrame:
        """Read one frame; a failure is a `ToolError`."""
        what = f"cannot read frame {index} back from {self._folder}"
        with as_tool_error(what), np.load(self.path(index), allow_pickle=False) as stored:
            return _evaluation_frame(dict(stored))

    def path(self, index: int) -> Path:
        """Return the file of a frame."""
        return self._folder / f"{index:06d}.npz"


def _arrays(frame: EvaluationFrame) -> dict[str, Any]:
    """The entries of a frame that are known, as arrays and numbers."""
    shown = {"stamp_s": frame.frame.stamp_s, "gray": frame.frame.gray, "depth_m": frame.frame.depth_m}
    return shown | {name: value for name, value in vars(frame).items() if name != "frame" and value is not None}


def _evaluation_frame(arrays: dict[str, Any]) -> EvaluationFrame:
    shown = Frame(stamp_s=float(arrays.pop("stamp_s")), gray=arrays.pop("gray"), depth_m=arrays.pop("depth_m"))
    unknown: dict[str, Any] = {"T_world_cam": None}
    return EvaluationFrame(frame=shown, **(unknown | arrays))


Frames = FrameCache | list[EvaluationFrame]
"""Frames that can be read repeatedly."""


class FrameSource(Protocol):
    """A sequence that methods can be compared on."""

    name: str
    seed: int | None
    """Seed of a rendered sequence; None for a measured one."""
    groups: Groups
    intrinsics: Intrinsics
    code: Code
    """What the frames depend on, beside the recording and the library."""

    def __len__(self) -> int:
        """Return the number of whole frames."""

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of all that the first frames are made of."""

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames with their references."""


class DatasetSource:
    """A recording of any format without true poses. One kind of its pixels is judged, see `kinds`."""

    seed: int | None = None
    code: Code = ()

    def __init__(self, name: str, dataset: Dataset, kind: Kind) -> None:
        self.name, self.groups, self._dataset, self._kind = name, kind.groups, dataset, kind
        self.intrinsics = mirrored(dataset.intrinsics) if kind.is_mirrored else dataset.intrinsics

    def __len__(self) -> int:
        return len(self._dataset)

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of the camera, the kind and all images, which are read for it."""
        total = sha256(f"{self.groups} {self.intrinsics} {self._kind.digest}".encode())
        last = min(frames + self._kind.later_frames, len(self._dataset))
        for frame in map(self._dataset.__getitem__, range(last)):
            crc32 = zlib.crc32(frame.depth_m.tobytes(), zlib.crc32(frame.gray.tobytes()))
            total.update(f"{frame.stamp_s} {crc32}".encode())
        return total.hexdigest()

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames with their references; a missing or damaged one is a `DatasetError`."""
        references, side = self._kind.begin(self._dataset), -1 if self._kind.is_mirrored else 1
        gray_before: GrayImage | None = None
        for index in range(frames):
            frame = self._dataset[index]
            images: tuple[npt.NDArray[Any], ...] = (frame.gray, *references.of(index, frame.depth_m))
            gray, given_m, reference_m, hidden = (np.ascontiguousarray(image[:, ::side]) for image in images)
            smooth = cv2.blur(gray, (5, 5)).astype(np.uint8)
            change = cv2.absdiff(smooth, smooth if gray_before is None else gray_before)
            yield EvaluationFrame(
                frame=Frame(stamp_s=frame.stamp_s, gray=gray, depth_m=given_m),
                T_world_cam=None,
                reference_m=reference_m,
                labels=self.groups.label(reference_m, hidden.astype(np.uint8)),
                static=(change <= SAME_GRAY) & (index > 0),
            )
            gray_before = smooth
