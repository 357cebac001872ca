"""Writing a recording, so that a dead process or a full disk costs at most the frames that are not yet committed."""

import fcntl
import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from types import TracebackType
from typing import Self

from voxdepth.types import FloatArray, Intrinsics

from ..errors import RecordingError
from ..types import Capture
from .calibration import CALIBRATION, calibration_toml
from .files import TEMPORARY, extend, read, replace
from .images import CHANNELS, Channel
from .ledger import CHECKSUMS, CONFIG, DESCRIPTION, Ledger, checksum_lines, digest, image_paths, pose_name
from .poses import GROUND_TRUTH, parse_pose, pose_line
from .reader import Recording


@dataclass(frozen=True, kw_only=True)
class EncodedFrame:
    """A frame whose images are in place, but which is not yet part of the recording."""

    index: int
    stamp_s: float
    pose: str
    """Its line in `groundtruth.txt`, without its end."""
    digests: Mapping[str, str]
    """SHA-256 of its parts, hexadecimal, in the order of `checksums.txt`."""


class RecordingWriter:
    """Appends frames to a recording; made by `create` or `resume`.

    A frame that is committed stays whole whatever happens to the process. If the whole machine stops, the last ones may
    be damaged, which `Recording.verify` finds. The number of the drone is not kept.
    """

    def __init__(self, folder: Path, intrinsics: Intrinsics) -> None:
        self.folder = folder
        self.intrinsics = intrinsics
        self._frames = 0
        self._last_stamp_s = float("-inf")
        self._ended = ""
        """Why no more frames can be written."""
        self._locked = -1
        """File descriptor of the folder while it is locked."""

    @classmethod
    def create(cls, folder: Path, *, intrinsics: Intrinsics, config_text: str) -> Self:
        """Start a recording.

        Args:
            folder: New, empty, or left by a call of this that failed; made together with its parents.
            intrinsics: Of the left camera, with a baseline.
            config_text: All that is needed to make the recording again, as TOML; kept as it is.

        Raises:
            RecordingError: There is something in the folder, or it cannot be written.
        """
        writer = cls(folder, intrinsics)
        description = {CONFIG: config_text.encode(), CALIBRATION: calibration_toml(intrinsics).encode()}
        with writer._writing(folder):
            if folder.exists() and not is_startable(folder):
                raise RecordingError(f"{folder} is not empty; name a new folder, or resume the recording that is there")
            folder.mkdir(parents=True, exist_ok=True)
        with writer._locked_or_closed():
            writer._begin_after(Ledger(poses=(), digests={}), description)
            for name, data in description.items():  # Last, for the calibration makes the folder a recording.
                writer._replace(name, data)
        return writer

    @classmethod
    def resume(cls, folder: Path, *, intrinsics: Intrinsics, config_text: str) -> Self:
        """Go on after the last whole frame of a recording; what there is of later frames is deleted.

        A frame that lacks a file is not whole, so deleting a damaged file makes way to record again from its frame on.

        Args:
            folder: Of the recording, which no other writer may have open.
            intrinsics: Those that the recording was created with.
            config_text: That which the recording was created with.

        Raises:
            RecordingError: The folder is no recording, it was made differently, is damaged, or cannot be written.
        """
        recording = Recording.open(folder)
        _refuse_other_config(folder, recording.config_text, config_text)
        if recording.intrinsics != intrinsics:
            raise RecordingError(f"{folder} was made with {recording.intrinsics} and cannot go on with {intrinsics}")
        writer = cls(folder, intrinsics)
        with writer._locked_or_closed():
            ledger = Recording.open(folder).ledger  # Again: another writer may have been at work until now.
            whole = Ledger(poses=ledger.poses[: _count_whole(folder, ledger)], digests=ledger.digests)
            writer._begin_after(whole, {name: read(folder / name) for name in DESCRIPTION})
        return writer

    @property
    def frames(self) -> int:
        """Number of whole frames; also the index of the next."""
        return self._frames

    def append(self, capture: Capture, q_world_cam_xyzw: FloatArray) -> None:
        """Write the next frame; like `encode` and `commit`."""
        self.commit(self.encode(self.frames, capture, q_world_cam_xyzw))

    def encode(self, index: int, capture: Capture, q_world_cam_xyzw: FloatArray) -> EncodedFrame:
        """Write the images of a frame. Any number of threads may do so at once, for different frames in any order.

        Args:
            index: Of the frame, not yet committed.
            capture: With both gray images.
            q_world_cam_xyzw: Unit quaternion, shape (4,), that the rotation of `capture.T_world_cam` was computed of.

        Raises:
            RecordingError: The capture does not fit the recording, or a file cannot be written.
        """
        self._refuse_if_ended()
        if index < self.frames:
            raise RecordingError(f"frame {index} is already recorded; the next is {self.frames}")
        if capture.intrinsics != self.intrinsics:
            raise RecordingError(f"expected captures with {self.intrinsics}, got one with {capture.intrinsics}")
        if capture.gray_right is None:
            raise RecordingError("expected captures with both gray images, got one without gray_right")
        pose = pose_line(capture.stamp_s, capture.T_world_cam, q_world_cam_xyzw)
        files = {
            channel.path(index): channel.encode(getattr(capture, channel.field), self.intrinsics.shape)
            for channel in CHANNELS
        }
        for name, data in files.items():
            self._replace(name, data)
        digests = {name: digest(data) for name, data in files.items()} | {pose_name(index): digest(pose.encode())}
        return EncodedFrame(index=index, stamp_s=capture.stamp_s, pose=pose, digests=digests)

    def commit(self, encoded: EncodedFrame) -> None:
        """Make an encoded frame part of the recording.

        Raises:
            RecordingError: It is not the next frame, it is not later than the one before, or a file cannot be written.
        """
        self._refuse_if_ended()
        if encoded.index != self.frames:
            raise RecordingError(f"expected frame {self.frames} to be committed next, got frame {encoded.index}")
        if encoded.stamp_s <= self._last_stamp_s:
            raise RecordingError(f"expected a frame later than {self._last_stamp_s} s, got one at {encoded.stamp_s} s")
        try:
            self._extend(GROUND_TRUTH, f"{encoded.pose}\n")
            self._extend(CHECKSUMS, checksum_lines(encoded.digests))
        except BaseException:
            self._ended = f"frame {encoded.index} could not be committed; resume it with a new writer"
            raise
        self._frames += 1
        self._last_stamp_s = encoded.stamp_s

    def close(self) -> None:
        """Refuse further frames; nothing is left to be written."""
        self._ended = self._ended or "the writer is closed; resume it with a new one"
        if self._locked >= 0:
            os.close(self._locked)
            self._locked = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @contextmanager
    def _locked_or_closed(self) -> Iterator[None]:
        """Take the folder for this writer; give it back if what follows fails."""
        try:
            self._lock()
            yield
        except BaseException:
            self.close()
            raise

    def _lock(self) -> None:
        """Keep other writers out of the folder, in this process and in others, until this one is closed or dies."""
        with self._writing(self.folder):
            self._locked = os.open(self.folder, os.O_RDONLY)
            try:
                fcntl.flock(self._locked, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise RecordingError(f"another writer is recording to {self.folder}: wait until it ends") from error

    def _begin_after(self, whole: Ledger, description: Mapping[str, bytes]) -> None:
        """Leave the frames of a ledger in the folder, and nothing of others."""
        self._frames = len(whole.poses)
        self._last_stamp_s = parse_pose(whole.poses[-1])[0] if whole.poses else float("-inf")
        for channel in CHANNELS:
            with self._writing(self.folder / channel.folder):
                (self.folder / channel.folder).mkdir(exist_ok=True)
                _drop_debris(self.folder, channel, self._frames)
        digests = {**whole.digests, **{name: digest(data) for name, data in description.items()}}
        kept = Ledger(poses=whole.poses, digests=digests)
        self._replace(CHECKSUMS, kept.checksums_text().encode())
        self._replace(GROUND_TRUTH, kept.ground_truth_text().encode())

    def _replace(self, name: str, data: bytes) -> None:
        with self._writing(self.folder / name):
            replace(self.folder / name, data)

    def _extend(self, name: str, text: str) -> None:
        with self._writing(self.folder / name):
            extend(self.folder / name, text.encode())

    @contextmanager
    def _writing(self, path: Path) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RecordingError(
                f"cannot write {path}: {error.strerror or error}; {self.frames} whole frames are safe in {self.folder}"
            ) from error

    def _refuse_if_ended(self) -> None:
        if self._ended:
            raise RecordingError(f"cannot write to {self.folder}: {self._ended}")


def is_startable(folder: Path) -> bool:
    """Whether a folder holds nothing but, perhaps, what `RecordingWriter.create` left when it failed."""
    ours = {channel.folder for channel in CHANNELS} | {CHECKSUMS, GROUND_TRUTH, CONFIG}
    ours |= {name + TEMPORARY for name in (CHECKSUMS, GROUND_TRUTH, CONFIG, CALIBRATION)}
    images = (path for channel in CHANNELS for path in (folder / channel.folder).glob("*"))
    return {path.name for path in folder.iterdir()} <= ours and not any(images)


def _refuse_other_config(folder: Path, recorded: str, given: str) -> None:
    if recorded == given:
        return
    lines = zip_longest(recorded.split("\n"), given.split("\n"), fillvalue="(nothing)")
    number, (there, here) = next((n, pair) for n, pair in enumerate(lines, 1) if pair[0] != pair[1])
    raise RecordingError(
        f"{folder} was made with another configuration: line {number} of its {CONFIG} reads {there!r}, not {here!r}; "
        "resume it with its own, or record into a new folder"
    )


def _count_whole(folder: Path, ledger: Ledger) -> int:
    """Number of frames before the first that lacks a file."""
    frames = range(len(ledger.poses))
    lacking = (i for i in frames if not all((folder / name).is_file() for name in image_paths(i)))
    return next(lacking, len(frames))


def _drop_debris(folder: Path, channel: Channel, n_frames: int) -> None:
    """Delete the images of a channel from a frame on, and those that were never finished."""
    pattern = re.compile(rf"(\d{{6,}}){re.escape(channel.suffix)}({re.escape(TEMPORARY)})?")
    for path in list((folder / channel.folder).iterdir()):
        match = pattern.fullmatch(path.name)
        if match and (match[2] or int(match[1]) >= n_frames):
            path.unlink()
