"""A stereo recording of the simulator, as a robot would have seen it: left gray images and raw depth, no truth.

Frame 7 is `gray_left/000007.png` and `depth_raw/000007.tiff` (float32 metres). Of `groundtruth.txt` only the times are
used. `checksums.txt` has the SHA-256 of every file and, as a comment that commits the frame, of its line in
`groundtruth.txt`; a frame without that comment was never finished and is left out.
"""

import re
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Self

from ..errors import DatasetError
from ..types import FloatImage, GrayImage, Intrinsics
from .calibration import CALIBRATION, choose_intrinsics
from .files import read_bytes, read_text
from .images import decode_depth_m, decode_gray
from .pairs import Pair, PairedImages
from .stamps import parse_stamp

CHECKSUMS, POSES, GRAY, DEPTH = "checksums.txt", "groundtruth.txt", "gray_left", "depth_raw"
_CHECKSUM = re.compile(r"(?:# )?([0-9a-f]{64})  (.+)")
_POSE_HEADER = "# timestamp tx ty tz qx qy qz qw"
_POSE_NUMBERS = 8


class RecordingDataset(PairedImages):
    """The whole frames of a recording; an image is compared with its checksum before it is decoded."""

    format = "recording"

    def __init__(self, folder: Path, pairs: Sequence[Pair], intrinsics: Intrinsics, digests: Mapping[str, str]) -> None:
        """Frames of the files in a folder; `digests` has the SHA-256 of a file by its path relative to the folder."""
        super().__init__(folder, pairs, intrinsics)
        self._folder = folder
        self._digests = digests

    @classmethod
    def lacking(cls, folder: Path) -> str:
        """What a folder lacks to be of this format, in words; empty if it is."""
        needed = (CALIBRATION, POSES, CHECKSUMS, GRAY, DEPTH)
        return ", ".join(name for name in needed if not (folder / name).exists())

    @classmethod
    def open(cls, folder: Path, intrinsics: Intrinsics | None = None) -> Self:
        """The recording in a folder, as far as it is whole at this moment.

        Raises:
            DatasetError: Its times, checksums or calibration are missing or damaged, or no frame is whole.
        """
        digests = _read_digests(folder / CHECKSUMS)
        stamps_s = _read_stamps(folder / POSES, digests)
        pairs = [
            Pair(stamp_s=stamp_s, gray=folder / GRAY / f"{index:06d}.png", depth=folder / DEPTH / f"{index:06d}.tiff")
            for index, stamp_s in enumerate(stamps_s)
        ]
        if intrinsics is None:
            _checked(folder, folder / CALIBRATION, digests)
        return cls(folder, pairs, choose_intrinsics(folder, intrinsics, lambda: _no_camera(folder)), digests)

    def _read_gray(self, pair: Pair) -> GrayImage:
        return decode_gray(_checked(self._folder, pair.gray, self._digests), pair.gray, self.intrinsics.shape)

    def _read_depth_m(self, pair: Pair) -> FloatImage:
        return decode_depth_m(_checked(self._folder, pair.depth, self._digests), pair.depth, self.intrinsics.shape)


def _no_camera(folder: Path) -> Intrinsics:
    raise DatasetError(f"expected a {CALIBRATION} in {folder}, got none; restore it, or give the intrinsics")


def _whole_lines(path: Path) -> list[str]:
    """Without the last one if it is cut short, as it is while the recording is written."""
    return read_text(path).split("\n")[:-1]


def _read_digests(path: Path) -> dict[str, str]:
    """SHA-256 by what it is of: a file, or `groundtruth.txt 000007` for a line of it."""
    digests = {}
    for number, line in enumerate(_whole_lines(path), 1):
        match = _CHECKSUM.fullmatch(line)
        if match is None:
            raise DatasetError(f"expected a checksum and a name in line {number} of {path}, got {line[:80]!r}")
        digests[match[2]] = match[1]
    return digests


def _read_stamps(path: Path, digests: Mapping[str, str]) -> list[float]:
    """Times of the whole frames [s]."""
    header, *lines = _whole_lines(path) or [_POSE_HEADER]
    if header != _POSE_HEADER:
        raise DatasetError(f"expected {_POSE_HEADER!r} as the first line of {path}, got {header[:80]!r}; restore it")
    stamps_s = []
    for index, line in enumerate(lines):
        expected = digests.get(f"{POSES} {index:06d}")
        if expected is None:
            break
        source = f"line {index + 2} of {path}"
        words = line.split(" ")
        if len(words) != _POSE_NUMBERS or sha256(line.encode()).hexdigest() != expected:
            raise DatasetError(f"{source} is damaged (wrong checksum); restore the file from a copy")
        stamps_s.append(parse_stamp(words[0], source))
    return stamps_s


def _checked(folder: Path, path: Path, digests: Mapping[str, str]) -> bytes:
    """A file whose checksum is right."""
    name = path.relative_to(folder).as_posix()
    if name not in digests:
        raise DatasetError(f"expected a checksum of {name} in {folder / CHECKSUMS}, got none; restore the list")
    data = read_bytes(path)
    if sha256(data).hexdigest() != digests[name]:
        raise DatasetError(f"{path} is damaged (wrong checksum); restore it from a copy or record again")
    return data
