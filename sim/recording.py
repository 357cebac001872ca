"""Stereo recordings on disk, with the true depth and pose of every frame, which read back exactly as they were written.

A recording is a folder. Frame 7 consists of the images `gray_left/000007.png`, `gray_right`, `depth_raw`, `depth_true`,
`occluded`, `segment` and `invalid_reason` with that name, and of row 7 of `frames.csv`, which holds its time and its
pose. The folder appears when all frames are written, with the checksums of the images and of the table.
"""

import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import cv2
import numpy as np
import numpy.typing as npt
import tomli_w

from voxdepth.checksums import LIST, DamageError, digest_of, list_of, require_whole
from voxdepth.types import FloatArray, Intrinsics

from .errors import RecordingError
from .types import Capture

Image = npt.NDArray[Any]

CONFIG, CALIBRATION, FRAMES = "config.toml", "calibration.toml", "frames.csv"
HEADER = "timestamp_s,r11,r12,r13,tx_m,r21,r22,r23,ty_m,r31,r32,r33,tz_m"
"""Columns of `frames.csv`: the time, and the first three rows of `T_world_cam`, rotation and translation."""

RUN_LENGTH = (cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE)
PNG = (cv2.IMWRITE_PNG_COMPRESSION, 1, *RUN_LENGTH, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP)
"""Run-length encoded differences to the row above: the fastest setting here, with files no larger than most."""

LZW = (cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_LZW)
TIFF_SMOOTH = (*LZW, cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_FLOATINGPOINT)
"""For smooth depth, whose neighbouring values are close. Deflate packs it 20 % smaller in twice the time."""
TIFF_STEPPED = (*LZW, cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_NONE)
"""For depth with few distinct values, as from disparities in sixteenths of a pixel, which repeat."""


@dataclass(frozen=True, kw_only=True)
class ImageChannel:
    """One image of every frame."""

    folder: str
    """Sub-folder of the recording."""
    field: str
    """Name in `Capture`."""
    dtype: type[np.generic]
    """Type of the image in `Capture`."""
    suffix: str = ".png"
    options: tuple[int, ...] = PNG
    """Options of OpenCV's encoder."""

    def path(self, index: int) -> str:
        """Return the path of the image of a frame, relative to the recording."""
        return f"{self.folder}/{index:06d}{self.suffix}"

    def encode(self, capture: Capture) -> bytes:
        """Return the bytes of the image file. A capture without the image raises a `RecordingError`."""
        image = getattr(capture, self.field)
        if image is None:
            raise RecordingError(f"expected a capture with {self.field}, got none: let the sensor render both cameras")
        return bytes(cv2.imencode(self.suffix, np.ascontiguousarray(_to_stored(image)), self.options)[1])

    def read(self, folder: Path, index: int, shape: tuple[int, int]) -> Image:
        """Return the image of a frame, as it was in the capture. A missing or damaged file is a `RecordingError`."""
        path = folder / self.path(index)
        stored = cv2.imdecode(np.frombuffer(read_bytes(path) or b"\0", np.uint8), cv2.IMREAD_UNCHANGED)
        image = None if stored is None else _from_stored(stored, self.dtype)
        if image is None or image.shape != shape or image.dtype != self.dtype:
            raise RecordingError(f"{path} is damaged: expected {self.field} of shape {shape}; record it again")
        return image


CHANNELS = (
    ImageChannel(folder="gray_left", field="gray_left", dtype=np.uint8),
    ImageChannel(folder="gray_right", field="gray_right", dtype=np.uint8),
    ImageChannel(folder="depth_raw", field="depth_raw_m", dtype=np.float32, suffix=".tiff", options=TIFF_STEPPED),
    ImageChannel(folder="depth_true", field="depth_true_m", dtype=np.float32, suffix=".tiff", options=TIFF_SMOOTH),
    ImageChannel(folder="occluded", field="occluded", dtype=np.bool_),
    ImageChannel(folder="segment", field="segment_id", dtype=np.int32),
    ImageChannel(folder="invalid_reason", field="invalid_reason", dtype=np.uint8),
)


def _to_stored(image: Image) -> Image:
    """Return an image as it is stored: masks as 0 and 255, segment ids plus one in 16 bits, all others as they are."""
    if image.dtype == np.bool_:
        return image.astype(np.uint8) * np.uint8(255)
    return (image + 1).astype(np.uint16) if image.dtype == np.int32 else image


def _from_stored(stored: Image, dtype: type[np.generic]) -> Image:
    """Return the inverse of `_to_stored`."""
    if dtype is np.bool_:
        return stored.astype(np.bool_)
    return stored.astype(np.int32) - np.int32(1) if dtype is np.int32 else stored


def read_poses(folder: Path) -> list[tuple[float, FloatArray]]:
    """Return the time of capture [s] and `T_world_cam`, shape (4, 4), of each row of `frames.csv`.

    A table that is missing or damaged raises a `RecordingError`.
    """
    path = folder / FRAMES
    header, *rows = read_bytes(path).decode(errors="replace").splitlines() or [""]
    if header != HEADER:
        raise RecordingError(f"{path} is damaged: expected the header {HEADER!r}, got {header[:80]!r}")
    poses = []
    for row in rows:
        try:
            stamp_s, *numbers = (float(word) for word in row.split(","))
            poses.append((stamp_s, np.vstack([np.reshape(numbers, (3, 4)), [0.0, 0.0, 0.0, 1.0]])))
        except ValueError as error:
            raise RecordingError(f"{path} is damaged: expected 13 numbers in a row, got {row[:80]!r}") from error
    return poses


def read_bytes(path: Path) -> bytes:
    """Return the content of a file. A file that is missing, damaged or cannot be read raises a `RecordingError`."""
    try:
        content = path.read_bytes()
        require_whole(path, content)
        return content
    except DamageError as error:
        raise RecordingError(str(error)) from error
    except OSError as error:
        raise RecordingError(
            f"cannot read {path}: {error.strerror or error}; restore it from a copy or record again"
        ) from error


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames of a recording, as captures of drone 0.

    An image that is damaged or missing makes only its own frame unreadable.
    """

    folder: Path
    poses: list[tuple[float, FloatArray]]
    """Time of capture [s] and `T_world_cam`, shape (4, 4), of each frame."""
    intrinsics: Intrinsics
    """Camera model of the left camera."""
    config_text: str
    """The configuration of the recording, as its writer was given it."""

    @classmethod
    def open(cls, folder: Path | str) -> Self:
        """Return the frames of a recording. No recording, or a damaged table, raises a `RecordingError`."""
        folder = Path(folder)
        if not (folder / FRAMES).is_file():
            raise RecordingError(f"{folder} is not a recording: expected a folder with a {FRAMES}")
        poses = read_poses(folder)
        try:
            intrinsics = Intrinsics(**tomllib.loads(read_bytes(folder / CALIBRATION).decode("utf-8-sig")))
        except (ValueError, TypeError, RecursionError) as error:
            raise RecordingError(f"{folder / CALIBRATION} is damaged ({error}); restore it from a copy") from error
        return cls(folder, poses, intrinsics, read_bytes(folder / CONFIG).decode(errors="replace"))

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Capture:
        """Return one frame; a negative index counts from the end. A damaged or missing image is a `RecordingError`."""
        index = range(len(self))[index]
        stamp_s, T_world_cam = self.poses[index]
        images: dict[str, Any] = {
            channel.field: channel.read(self.folder, index, self.intrinsics.shape) for channel in CHANNELS
        }
        return Capture(stamp_s=stamp_s, drone=0, T_world_cam=T_world_cam, intrinsics=self.intrinsics, **images)

    def __iter__(self) -> Iterator[Capture]:
        return (self[index] for index in range(len(self)))

    def digest(self, frames: int) -> str:
        """Return the SHA-256, hexadecimal, of the configuration, the calibration and everything in the first frames."""
        total = sha256()
        for name in (CONFIG, CALIBRATION, *(channel.path(k) for k in range(frames) for channel in CHANNELS)):
            total.update(sha256(read_bytes(self.folder / name)).digest())
        for stamp_s, T_world_cam in self.poses[:frames]:
            total.update(f"{stamp_s!r} {T_world_cam.tolist()}".encode())
        return total.hexdigest()


class RecordingWriter:
    """Writes a recording. Use it as a context manager: the folder appears when the block ends without an error.

    The folder must be new or empty. A recording does not keep the number of the drone. `config_text` is everything that
    is needed to repeat the recording, as TOML; it is kept unchanged. The camera is a stereo camera.

    Raises:
        RecordingError: The folder holds something, or cannot be written.
    """

    def __init__(self, folder: Path, *, intrinsics: Intrinsics, config_text: str) -> None:
        self._folder = folder
        calibration = asdict(intrinsics)
        optional = {name: calibration.pop(name) for name in ("baseline_m", "disparity_scale")}
        if intrinsics.disparity_scale == 1:
            del optional["disparity_scale"]  # As in recordings from before it was a field.
        # The size of the images comes last, so that a file that was cut lacks or contradicts it.
        calibration_text = tomli_w.dumps(optional | calibration)
        self._description = {CONFIG: config_text.encode(), CALIBRATION: calibration_text.encode()}
        self._rows: list[str] = []
        self._digests: dict[str, str] = {}

    @property
    def frames(self) -> int:
        """Number of complete frames; also the index of the next frame."""
        return len(self._rows)

    def append(self, capture: Capture) -> None:
        """Write the next frame: its images, then its row."""
        self.write_images(self.frames, capture)
        self.append_row(capture)

    def write_images(self, index: int, capture: Capture) -> None:
        """Write the images of a frame. Several threads may write different frames at once."""
        encoded = {channel.path(index): channel.encode(capture) for channel in CHANNELS}
        for path, data in encoded.items():
            self._write(path, data)

    def append_row(self, capture: Capture) -> None:
        """Add the row of the next frame, whose images are written."""
        numbers = (capture.stamp_s, *capture.T_world_cam[:3].ravel())
        self._rows.append(",".join(repr(float(number)) for number in numbers))

    def __enter__(self) -> Self:
        with _writing(self._folder):
            self._folder.parent.mkdir(parents=True, exist_ok=True)
            if self._folder.exists() and any(self._folder.iterdir()):
                raise RecordingError(f"{self._folder} is not empty; name a new folder")
            self._holder = TemporaryDirectory(dir=self._folder.parent, prefix=f".{self._folder.name}-")
            self._unfinished = Path(self._holder.name) / self._folder.name
            for channel in CHANNELS:
                (self._unfinished / channel.folder).mkdir(parents=True)
        return self

    def __exit__(self, error: object, *_: object) -> None:
        with self._holder, _writing(self._folder):
            if error is None:
                for name, data in self._description.items():
                    (self._unfinished / name).write_bytes(data)
                self._write(FRAMES, "".join(f"{row}\n" for row in (HEADER, *self._rows)).encode())
                (self._unfinished / LIST).write_bytes(list_of(self._digests))
                self._unfinished.replace(self._folder)

    def _write(self, name: str, data: bytes) -> None:
        """Write a file that nobody edits, whose checksum is listed."""
        with _writing(self._folder):
            (self._unfinished / name).write_bytes(data)
        self._digests[name] = digest_of(data)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise RecordingError(f"cannot write {folder}: {error.strerror or error}") from error
