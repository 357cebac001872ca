"""Writing a recording that can be continued after an interruption."""

import fcntl
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import zip_longest
from pathlib import Path
from typing import Self

from voxdepth.types import Intrinsics

from ..errors import RecordingError
from ..types import Capture
from .format import CALIBRATION, CHANNELS, CONFIG, FRAMES, HEADER, calibration_toml, frame_row, read_bytes, read_poses


class RecordingWriter:
    """Appends frames to a recording. Use it as a context manager; it locks the folder against other writers.

    A new or empty folder becomes a recording. An existing recording is continued after the last complete row of
    `frames.csv`; images of later frames are deleted. A recording does not keep the number of the drone. `config_text`
    is everything that is needed to repeat the recording, as TOML; it is kept unchanged.

    Raises:
        RecordingError: The folder holds something else, or a recording with another camera or configuration. It is in
            use by another writer, or it cannot be written.
    """

    def __init__(self, folder: Path, *, intrinsics: Intrinsics, config_text: str) -> None:
        self.folder = folder
        self.intrinsics = intrinsics
        self.frames = 0
        """Number of complete frames; also the index of the next frame."""
        self._last_stamp_s = float("-inf")
        description = {CONFIG: config_text.encode(), CALIBRATION: calibration_toml(intrinsics).encode()}
        with self._writing(folder):
            if (folder / FRAMES).exists():
                _require_same_description(folder, description)
            else:
                _start(folder, description)
            self._table = (folder / FRAMES).open("ab")
        try:
            with self._writing(folder):
                self._lock()
                self._continue()
        except BaseException:
            self.close()
            raise

    def append(self, capture: Capture) -> None:
        """Write the next frame: its images, then its row."""
        self.write_images(self.frames, capture)
        self.append_row(capture)

    def write_images(self, index: int, capture: Capture) -> None:
        """Write the images of a frame that has no row yet. Several threads may write different frames at once.

        A capture that does not fit the recording, or a failed write, raises a `RecordingError`.
        """
        self._require_open()
        if index < self.frames:
            raise RecordingError(f"frame {index} is already recorded; the next is {self.frames}")
        if capture.intrinsics != self.intrinsics:
            raise RecordingError(f"expected captures with {self.intrinsics}, got one with {capture.intrinsics}")
        frame_row(capture)
        encoded = {self.folder / channel.path(index): channel.encode(capture) for channel in CHANNELS}
        for path, data in encoded.items():
            with self._writing(path):
                path.write_bytes(data)

    def append_row(self, capture: Capture) -> None:
        """Add the row of the next frame, whose images are written. The frame is then part of the recording.

        Missing images, a capture that is not later than the one before, or a failed write raise a `RecordingError`. A
        failed write also closes the writer.
        """
        self._require_open()
        for path in (self.folder / channel.path(self.frames) for channel in CHANNELS):
            if not path.is_file():
                raise RecordingError(f"expected the images of frame {self.frames} before its row: {path} is missing")
        if capture.stamp_s <= self._last_stamp_s:
            raise RecordingError(f"expected a frame later than {self._last_stamp_s} s, got one at {capture.stamp_s} s")
        try:
            with self._writing(self.folder / FRAMES):
                self._table.write(f"{frame_row(capture)}\n".encode())
                self._table.flush()
        except BaseException:
            self.close()
            raise
        self.frames += 1
        self._last_stamp_s = capture.stamp_s

    def close(self) -> None:
        """Release the folder; further frames are refused."""
        with suppress(OSError):
            self._table.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _lock(self) -> None:
        """Keep other writers out, in this and other processes, until this writer is closed or its process ends."""
        try:
            fcntl.flock(self._table, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise RecordingError(f"another writer is recording to {self.folder}: wait until it ends") from error

    def _continue(self) -> None:
        """Cut the recording after the last complete row of which all images, and those of the rows before, exist."""
        poses = read_poses(self.folder)
        missing = (k for k in range(len(poses)) if not all((self.folder / c.path(k)).is_file() for c in CHANNELS))
        self.frames = next(missing, len(poses))
        if self.frames:
            self._last_stamp_s = poses[self.frames - 1][0]
            kept = read_bytes(self.folder / FRAMES).split(b"\n")[: self.frames + 1]
            self._table.truncate(sum(len(line) + 1 for line in kept))
        else:
            self._table.truncate(0)
            self._table.write(f"{HEADER}\n".encode())
            self._table.flush()
        for channel in CHANNELS:
            (self.folder / channel.folder).mkdir(exist_ok=True)
            for path in (self.folder / channel.folder).glob(f"[0-9]*{channel.suffix}"):
                if int(path.stem) >= self.frames:
                    path.unlink()

    def _require_open(self) -> None:
        if self._table.closed:
            raise RecordingError(f"the writer of {self.folder} is closed; continue the recording with a new one")

    @contextmanager
    def _writing(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RecordingError(
                f"cannot write {path}: {error.strerror or error}; {self.frames} complete frames are in {self.folder}"
            ) from error


def _start(folder: Path, description: dict[str, bytes]) -> None:
    """Write the files that describe a new recording. The table of frames, which makes it a recording, comes later."""
    folder.mkdir(parents=True, exist_ok=True)
    if {path.name for path in folder.iterdir()} - description.keys():
        raise RecordingError(f"{folder} is not empty; name a new folder, or that of a recording")
    for name, data in description.items():
        (folder / name).write_bytes(data)


def _require_same_description(folder: Path, description: dict[str, bytes]) -> None:
    for name, data in description.items():
        lines = zip_longest(read_bytes(folder / name).split(b"\n"), data.split(b"\n"), fillvalue=b"(nothing)")
        for number, (recorded, given) in enumerate(lines, 1):
            if recorded != given:
                raise RecordingError(
                    f"{folder} was recorded differently: line {number} of its {name} is {_text(recorded)!r}, not "
                    f"{_text(given)!r}; continue it with its own configuration, or record into a new folder"
                )


def _text(line: bytes) -> str:
    return line.decode(errors="replace")
