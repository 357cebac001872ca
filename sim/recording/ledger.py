"""What the text files of a recording say: which frames are whole, what their files hash to, where they were taken.

`checksums.txt` is what `sha256sum -c` reads: first the two files that describe the recording, then the images of each
frame, each time followed by a comment with the hash of the frame's line in `groundtruth.txt`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from ..errors import RecordingError
from .calibration import CALIBRATION
from .files import read
from .images import CHANNELS
from .poses import GROUND_TRUTH, HEADER

CHECKSUMS = "checksums.txt"
CONFIG = "config.toml"
DESCRIPTION = (CONFIG, CALIBRATION)
"""Files that describe all frames."""


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """The frames that are written down in full."""

    poses: tuple[str, ...]
    """The line of each frame in `groundtruth.txt`, without its end."""
    digests: Mapping[str, str]
    """SHA-256 of each file and of each of `poses`, hexadecimal."""

    def ground_truth_text(self) -> str:
        """What `groundtruth.txt` holds."""
        return "".join(f"{line}\n" for line in (HEADER, *self.poses))

    def checksums_text(self) -> str:
        """What `checksums.txt` holds."""
        return checksum_lines({name: self.digests[name] for name in _names(len(self.poses))})


def digest(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return sha256(data).hexdigest()


def image_paths(index: int) -> list[str]:
    """The images of a frame, relative to the recording."""
    return [channel.path(index) for channel in CHANNELS]


def pose_name(index: int) -> str:
    """What the line of a frame in `groundtruth.txt` is called among the checksums."""
    return f"{GROUND_TRUTH} {index:06d}"


def checksum_lines(digests: Mapping[str, str]) -> str:
    """Lines of `checksums.txt`, in the order of the mapping."""
    return "".join(_checksum_line(name, hexadecimal) for name, hexadecimal in digests.items())


def read_ledger(folder: Path) -> Ledger:
    """What is written down in full; a frame that was being written when its writer died is left out.

    Raises:
        RecordingError: A text file is missing or damaged.
    """
    digests = _read_digests(folder / CHECKSUMS)  # First, for a writer that is still at work appends to it last.
    header, *poses = _whole_lines(folder / GROUND_TRUTH) or [HEADER]
    if header != HEADER:
        raise _damaged(folder / GROUND_TRUTH, 1)
    n_frames = min(max(0, len(digests) - len(_names(0))) // len(_names_of_frame(0)), len(poses))
    for index, line in enumerate(poses[:n_frames]):
        if digest(line.encode()) != digests[pose_name(index)]:
            raise _damaged(folder / GROUND_TRUTH, index + 2)
    return Ledger(poses=tuple(poses[:n_frames]), digests=digests)


def _names(n_frames: int) -> list[str]:
    """All that has a checksum, in the order of the lines."""
    return [*DESCRIPTION, *(name for index in range(n_frames) for name in _names_of_frame(index))]


def _names_of_frame(index: int) -> list[str]:
    return [*image_paths(index), pose_name(index)]


def _checksum_line(name: str, hexadecimal: str) -> str:
    comment = "# " if name.startswith(GROUND_TRUTH) else ""
    return f"{comment}{hexadecimal}  {name}\n"


def _read_digests(path: Path) -> dict[str, str]:
    lines = _whole_lines(path)
    digests = {}
    for number, (line, name) in enumerate(zip(lines, _names(len(lines)), strict=False), 1):
        hexadecimal = line.removeprefix("# ")[:64]
        if _checksum_line(name, hexadecimal) != f"{line}\n":
            raise _damaged(path, number)
        digests[name] = hexadecimal
    return digests


def _whole_lines(path: Path) -> list[str]:
    """Without the last one if it is cut short."""
    return read(path).decode(errors="replace").split("\n")[:-1]


def _damaged(path: Path, number: int) -> RecordingError:
    return RecordingError(f"line {number} of {path} is damaged; restore the file from a copy")
