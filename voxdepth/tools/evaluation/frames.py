"""The frames of a sequence, each with the depth that methods are evaluated against, and where they are evaluated."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from ...types import FloatImage, Frame, Intrinsics, MaskImage
from ..files import as_tool_error

ALL, NEAR = "all", "0-20 m"
"""All pixels, and the range of most measurements: the depths that a drone avoids obstacles by."""
NEAR_M = 20.0
"""End of that range [m]."""
RANGES = {"0-2 m": (0.0, 2.0), "2-5 m": (2.0, 5.0), "5-10 m": (5.0, 10.0), "10-20 m": (10.0, NEAR_M)}
RANGES |= {"over 20 m": (NEAR_M, math.inf)}
"""Parts of all ranges, by which the error of fills is reported: first depth and end of each [m]."""
HOLES = "holes"
"""Mask of the pixels that the sensor has no depth for."""
MEASURED, OCCLUDED = "measured", "occluded"
"""Masks of the pixels whose depth methods are given, and of those that the second camera does not see."""


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What methods are evaluated against in a sequence."""

    name: str
    """Such as `the truth`."""
    hidden: str = HOLES
    """Mask of the pixels that methods are given no depth of, which tables about filling are about."""
    is_true: bool
    """Whether it is the true depth, and not a measurement, which flickers itself."""

    is_mirrored: bool = False
    """Whether methods are given mirrored images, in which left and right are exchanged."""

    def flipped(self, image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return an image of the recording as methods are given it, or one of theirs as the recording has it."""
        return np.ascontiguousarray(image[:, :: -1 if self.is_mirrored else 1])

    @property
    def is_independent(self) -> bool:
        """Whether measured pixels can be evaluated against it, too: it is not what methods are given."""
        return self.hidden == HOLES


TRUTH = Reference(name="the truth", is_true=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationFrame:
    """A frame with its reference. Methods see only `frame`."""

    frame: Frame
    reference_m: FloatImage
    """True or measured depth [m], shape (H, W), float32; 0 = unknown, +inf = no surface."""
    hidden: MaskImage
    """Pixels that methods are given no depth of and are evaluated on, shape (H, W)."""
    static: MaskImage
    """Pixels that show the same surface as in the frame before, shape (H, W)."""
    occluded: MaskImage | None = None
    """Pixels that the second camera does not see, shape (H, W); None if they are unknown."""
    moving: MaskImage | None = None
    """Pixels of moving objects, shape (H, W); None if there are none or they are unknown."""
    departed_m: FloatImage | None = None
    """Depth of the moving object that left a pixel some frames ago [m], shape (H, W); 0 elsewhere."""

    def known(self) -> MaskImage:
        """Return the pixels with a reference, shape (H, W)."""
        return np.asarray((self.reference_m > 0) & (self.reference_m < np.inf))

    def near(self) -> MaskImage:
        """Return those of them within `NEAR_M`, shape (H, W)."""
        return np.asarray((self.reference_m > 0) & (self.reference_m < np.float32(NEAR_M)))

    def within(self, name: str) -> MaskImage:
        """Return those of them in one of `RANGES`, shape (H, W)."""
        start_m, end_m = map(np.float32, RANGES[name])
        return np.asarray(self.known() & (self.reference_m >= start_m) & (self.reference_m < end_m))

    def masks(self, hidden: str) -> dict[str, MaskImage]:
        """Return the masks that a frame has but `ALL`, where `hidden` is the name of the hidden pixels."""
        masks = {MEASURED: ~self.hidden, hidden: self.hidden}
        return masks if self.occluded is None else masks | {OCCLUDED: self.occluded}


class FrameFile:
    """Frames of one sequence in a file without a name: they are computed once, and only one is in memory.

    A megapixel takes 11 MB, or 16 MB where things move.
    """

    def __init__(self, folder: Path) -> None:
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115 - `__exit__` closes it.
        self._names: list[list[str]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):  # What could not be written is reported already, and nobody reads the rest.
            self._file.close()

    def fill(self, frames: Iterable[EvaluationFrame], progress: Callable[[int], None] = lambda count: None) -> None:
        """Write frames and pass their number to `progress`; a frame that cannot be written is a `ToolError`."""
        for index, frame in enumerate(frames):
            seen = frame.frame
            values: dict[str, Any] = {"stamp_s": seen.stamp_s, "gray": seen.gray, "depth_m": seen.depth_m}
            values |= {name: value for name, value in vars(frame).items() if name != "frame" and value is not None}
            with as_tool_error(f"cannot keep frame {index}"):
                for value in values.values():
                    np.save(self._file, value, allow_pickle=False)
                self._file.flush()
            self._names.append(list(values))
            progress(len(self))

    def __len__(self) -> int:
        return len(self._names)

    def __iter__(self) -> Iterator[EvaluationFrame]:
        """Read the frames; one iteration at a time."""
        self._file.seek(0)
        for names in self._names:
            arrays = {name: np.load(self._file, allow_pickle=False) for name in names}
            stamp_s, gray, depth_m = map(arrays.pop, ("stamp_s", "gray", "depth_m"))
            yield EvaluationFrame(frame=Frame(stamp_s=float(stamp_s), gray=gray, depth_m=depth_m), **arrays)


Frames = FrameFile | list[EvaluationFrame]
"""Frames that can be read repeatedly."""
Code = Sequence[tuple[str, str]]
"""Packages and patterns of their files, see `code_digest`."""


class FrameSource(Protocol):
    """An open sequence that methods can be compared on."""

    name: str
    seed: int | None
    """Seed of a rendered sequence; None for a measured one."""
    reference: Reference
    intrinsics: Intrinsics
    code: Code
    """What the frames depend on, beside the recording and the library."""

    def __len__(self) -> int:
        """Return the number of whole frames."""

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of all that the first frames are made of."""

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames with their references."""
