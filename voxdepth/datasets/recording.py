"""Reads the left gray images and the raw depth of a stereo recording of the simulator. The true depth is not read.

Frame 7 is `gray_left/000007.png` and `depth_raw/000007.tiff` (float32 metres). Row 7 of `frames.csv` begins with its
time; the other columns hold the true pose, which is ignored. The simulator adds the row after the images, so that a
frame without a row is incomplete.
"""

from pathlib import Path

from ..errors import DatasetError
from ..types import Intrinsics
from .files import CALIBRATION, no_camera, read_text
from .pairs import Pair, PairedImages, parse_stamp

FRAMES, GRAY, DEPTH = "frames.csv", "gray_left", "depth_raw"
_HEADER = "timestamp_s,r11,r12,r13,tx_m,r21,r22,r23,ty_m,r31,r32,r33,tz_m"


class RecordingDataset(PairedImages):
    """The complete frames of a recording."""

    format = "recording"

    @classmethod
    def missing(cls, folder: Path) -> str:
        """See `PairedImages`."""
        return ", ".join(name for name in (CALIBRATION, FRAMES, GRAY, DEPTH) if not (folder / name).exists())

    def _find_pairs(self, folder: Path) -> list[Pair]:
        return [
            Pair(stamp_s=stamp_s, gray=folder / GRAY / f"{index:06d}.png", depth=folder / DEPTH / f"{index:06d}.tiff")
            for index, stamp_s in enumerate(_read_stamps(folder / FRAMES))
        ]

    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        raise no_camera(f"the {CALIBRATION} of {folder} has no camera", folder)


def _read_stamps(path: Path) -> list[float]:
    """Return the times of the frames [s]. A last row without a line break was being written, and is left out."""
    header, *rows = read_text(path).split("\n")[:-1] or [_HEADER]
    if header != _HEADER:
        raise DatasetError(f"expected {_HEADER!r} as the first line of {path}, got {header[:80]!r}; restore it")
    stamps_s = []
    for number, row in enumerate(rows, 2):
        words = row.split(",")
        if len(words) != len(_HEADER.split(",")):
            raise DatasetError(f"line {number} of {path} is damaged: it has {len(words)} columns; restore the file")
        stamps_s.append(parse_stamp(words[0], f"line {number} of {path}"))
    return stamps_s
