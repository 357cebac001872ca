"""Kinds of pixels that methods are judged by in a real recording, and where the reference of each comes from."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path

from ...datasets import Dataset
from ...errors import VoxDepthError
from .groups import HOLE_GROUPS, Groups, held_out_groups
from .later_frames import LATER_FRAMES, LaterFrames
from .references import TRUE_DEPTH, TRUE_DEPTHS, WIDENING, Patches, References, Shadows, TrueHoles

Opened = Callable[[Path], Dataset]
"""Opens a recording."""


@dataclass(frozen=True)
class Kind:
    """A kind of pixels that methods are given no depth of and are judged by."""

    groups: Groups
    begin: Callable[[Dataset], References]
    """Begins to read a recording."""
    is_mirrored: bool = False
    """Whether methods are given mirrored images, in which left and right are exchanged."""
    later_frames: int = 0
    """Number of frames after a frame that its reference is made of."""
    digest: str = ""
    """Digest of the files that references are read from, besides those of the frames."""

    @property
    def name(self) -> str:
        """The mask of these pixels, which is part of the names of sequences."""
        return self.groups.hidden


HELD_OUT = (
    Kind(held_out_groups("shadows"), lambda dataset: Shadows(dataset.intrinsics), is_mirrored=True),
    Kind(held_out_groups("wide-shadows"), lambda dataset: Shadows(dataset.intrinsics, WIDENING), is_mirrored=True),
    Kind(held_out_groups("patches"), lambda dataset: Patches(dataset.intrinsics)),
)
"""Kinds of measured pixels that are held out, which any recording has."""
HOLES_BY_LATER_FRAMES = Kind(
    replace(HOLE_GROUPS, reference_name="later frames", is_true=False), LaterFrames, later_frames=LATER_FRAMES
)
"""The sensor's own holes of a recording without the truth."""


def kinds_of(folder: Path, opened: Opened) -> list[Kind]:
    """Return the kinds of pixels that methods can be judged by in a recording."""
    truths = [folder / TRUE_DEPTH, *sorted((folder / TRUE_DEPTHS).glob("*.png"))]
    if found := [path for path in truths if path.is_file()]:
        digest = sha256(b"".join(sha256(path.read_bytes()).digest() for path in found)).hexdigest()
        return [*HELD_OUT, Kind(HOLE_GROUPS, partial(TrueHoles, folder), digest=digest)]
    with suppress(VoxDepthError):
        if len(opened(folder)) > 2:
            return [*HELD_OUT, HOLES_BY_LATER_FRAMES]
    return list(HELD_OUT)
