"""Reading a recording back, exactly as it was written."""

from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any, Self

from voxdepth.types import FloatArray, Intrinsics

from ..errors import RecordingError
from ..types import Capture
from .format import CALIBRATION, CHANNELS, CONFIG, FRAMES, parse_row, read_bytes, read_calibration, read_rows


class Recording:
    """The complete frames of a recording, as captures of drone 0.

    An image that is damaged or missing makes only its own frame unreadable.
    """

    def __init__(
        self, folder: Path, poses: list[tuple[float, FloatArray]], intrinsics: Intrinsics, config_text: str
    ) -> None:
        self.folder = folder
        self._poses = poses
        self.intrinsics = intrinsics
        """Camera model of the left camera."""
        self.config_text = config_text
        """The configuration of the recording, as its writer was given it."""

    @classmethod
    def open(cls, folder: Path | str) -> Self:
        """The frames that a recording holds at this moment.

        Raises:
            RecordingError: The folder is no recording, or one of its tables is damaged.
        """
        folder = Path(folder)
        if not (folder / FRAMES).is_file():
            raise RecordingError(f"{folder} is not a recording: expected a folder with a {FRAMES}")
        poses = [parse_row(row, folder / FRAMES) for row in read_rows(folder)]
        return cls(folder, poses, read_calibration(folder), read_bytes(folder / CONFIG).decode(errors="replace"))

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._poses)

    def __getitem__(self, index: int) -> Capture:
        """One frame; a negative index counts from the end.

        Raises:
            IndexError: The recording has no such frame.
            RecordingError: An image of the frame is damaged or missing.
        """
        index = range(len(self))[index]
        stamp_s, T_world_cam = self._poses[index]
        images: dict[str, Any] = {
            channel.field: channel.read(self.folder, index, self.intrinsics.shape) for channel in CHANNELS
        }
        return Capture(stamp_s=stamp_s, drone=0, T_world_cam=T_world_cam, intrinsics=self.intrinsics, **images)

    def __iter__(self) -> Iterator[Capture]:
        """All frames in order."""
        return (self[index] for index in range(len(self)))

    def digest(self, frames: int) -> str:
        """SHA-256, hexadecimal, of the configuration, the calibration and everything in the first frames.

        Raises:
            RecordingError: A file is missing.
        """
        total = sha256()
        for name in (CONFIG, CALIBRATION, *(channel.path(k) for k in range(frames) for channel in CHANNELS)):
            total.update(sha256(read_bytes(self.folder / name)).digest())
        for stamp_s, T_world_cam in self._poses[:frames]:
            total.update(f"{stamp_s!r} {T_world_cam.tolist()}".encode())
        return total.hexdigest()
