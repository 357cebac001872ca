"""What the text files of a recording say: which frames are whole, what their files hash to and where they were taken.

`checksums.txt` is what `sha256sum -c` reads: first the two files that describe the recording, then the files of each
frame. A comment after them holds the hash of the frame's line in `groundtruth.txt`.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from itertools import chain
from pathlib import Path

from ..errors import RecordingError
from .calibration import CALIBRATION
from .images import CHANNELS
from .poses import GROUND_TRUTH, HEADER

CHECKSUMS = "checksums.txt"
CONFIG = "config.toml"
DESCRIPTION = (CONFIG, CALIBRATION)
"""The files that describe all frames, in the order of their checksums."""


@dataclass(frozen=True, kw_only=True)
class Ledger:
    """The frames that both text files hold in full."""

    poses: tuple[str, ...]
    """The line of each frame in `groundtruth.txt`, without its end."""
    digests: Mapping[str, str]
    """SHA-256 of what each label names, hexadecimal; perhaps also of a part of the frame after the last."""

    def truth_text(self) -> str:
        """What `groundtruth.txt` holds."""
        return "".join(f"{line}\n" for line in (HEADER, *self.poses))

    def checksums_text(self) -> str:
        """What `checksums.txt` holds."""
        return checksum_lines((label, self.digests[label]) for label in labels(len(self.poses)))


def digest(data: bytes) -> str:
    """SHA-256, hexadecimal."""
    return sha256(data).hexdigest()


def checksum_lines(digests: Iterable[tuple[str, str]]) -> str:
    """Lines of `checksums.txt` from pairs of label and digest."""
    return "".join(f"{hexadecimal}  {label}\n" for label, hexadecimal in digests)


def image_paths(index: int) -> list[str]:
    """The files of a frame, relative to the recording."""
    return [channel.path(index) for channel in CHANNELS]
