"""Reading a recording back, exactly as it was written."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from voxdepth.types import Intrinsics

from ..errors import RecordingError
from ..types import Capture
from .calibration import CALIBRATION, parse_calibration
from .files import read
from .images import CHANNELS, Channel, Image
from .ledger import CONFIG, DESCRIPTION, Ledger, digest, image_paths, read_ledger
from .poses import parse_pose


class Recording:
    """The whole frames of a recording, as captures of drone 0. Every file is checked before it is used.

    A file that is damaged or gone stops nothing but the frame that it belongs to.
    """

    def __init__(self, folder: Path, ledger: Ledger, intrinsics: Intrinsics, config_text: str) -> None:
        self.folder = folder
        self.ledger = ledger
        self.intrinsics = intrinsics
        """Of the left camera."""
        self.config_text = config_text
        """What the recording was made with, as its maker wrote it."""

    @classmethod
    def open(cls, folder: Path | str) -> "Recording":
        """The recording in a folder, as far as it is whole at this moment.

        Raises:
            RecordingError: The folder is no recording, or what describes its frames is damaged.
        """
        folder = Path(folder)
        if not (folder / CALIBRATION).is_file():
            raise RecordingError(f"{folder} is not a recording: expected a folder with a {CALIBRATION}")
        ledger = read_ledger(folder)
        texts = {name: _checked(folder, name, ledger).decode(errors="replace") for name in DESCRIPTION}
        return cls(folder, ledger, parse_calibration(texts[CALIBRATION]), texts[CONFIG])

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.ledger.poses)

    def __getitem__(self, index: int) -> Capture:
        """One frame, counted from the end if negative.

        Raises:
            IndexError: There are not so many.
            RecordingError: A file of it is damaged or missing.
        """
        index = range(len(self))[index]
        stamp_s, T_world_cam = parse_pose(self.ledger.poses[index])
        images: dict[str, Any] = {channel.field: self._image(channel, index) for channel in CHANNELS}
        return Capture(stamp_s=stamp_s, drone=0, T_world_cam=T_world_cam, intrinsics=self.intrinsics, **images)

    def __iter__(self) -> Iterator[Capture]:
        """All frames in order."""
        return (self[index] for index in range(len(self)))

    def verify(self) -> None:
        """Read every file of every frame, as it is now, and compare it with its checksum.

        Raises:
            RecordingError: One is damaged or missing; the message names the first.
        """
        ledger = read_ledger(self.folder)
        frames = (name for index in range(len(ledger.poses)) for name in image_paths(index))
        for name in (*DESCRIPTION, *frames):
            _checked(self.folder, name, ledger)

    def _image(self, channel: Channel, index: int) -> Image:
        name = channel.path(index)
        image = channel.decode(_checked(self.folder, name, self.ledger))
        if image is None or not channel.fits(image, self.intrinsics.shape):
            raise RecordingError(
                f"expected {channel.field} of shape {self.intrinsics.shape} in {self.folder / name}, got something "
                "else; record again"
            )
        return image


def _checked(folder: Path, name: str, ledger: Ledger) -> bytes:
    """A file whose checksum is right, or not yet written."""
    data = read(folder / name)
    if ledger.digests.get(name, digest(data)) != digest(data):
        raise RecordingError(f"{folder / name} is damaged (wrong checksum); restore it from a copy or record again")
    return data
