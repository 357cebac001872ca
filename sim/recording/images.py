"""How each image of a capture is stored: exactly, in formats that any image viewer opens."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import RecordingError

Image = npt.NDArray[Any]

LARGEST_ID = np.iinfo(np.uint16).max - 1
"""Largest segment id that a recording can hold; ids are stored plus one."""

PNG = (
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_RLE,
    cv2.IMWRITE_PNG_FILTER,
    cv2.IMWRITE_PNG_FILTER_UP,
)
"""Differences to the row above, of which only runs are searched: the fastest here, and no larger than most."""

LZW = (cv2.IMWRITE_TIFF_COMPRESSION, cv2.IMWRITE_TIFF_COMPRESSION_LZW)
TIFF_SMOOTH = (*LZW, cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_FLOATINGPOINT)
"""For depth whose every value is new, but close to its neighbour's. Deflate packs it 20 % smaller in twice the time."""
TIFF_STEPPED = (*LZW, cv2.IMWRITE_TIFF_PREDICTOR, cv2.IMWRITE_TIFF_PREDICTOR_NONE)
"""For depth of few values, as of matching in sixteenths of a pixel: repetition packs better than differences."""


def _as_is(image: Image) -> Image:
    return image


def _mask_to_gray(mask: Image) -> Image:
    return mask.astype(np.uint8) * np.uint8(255)


def _gray_to_mask(gray: Image) -> Image:
    return gray.astype(np.bool_)


def _id_to_label(segment_id: Image) -> Image:
    low, high = int(segment_id.min()), int(segment_id.max())
    if low < -1 or high > LARGEST_ID:
        raise RecordingError(f"segment_id must lie in -1..{LARGEST_ID} to be recorded, got ids from {low} to {high}")
    return (segment_id + 1).astype(np.uint16)


def _label_to_id(label: Image) -> Image:
    return label.astype(np.int32) - np.int32(1)


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One image of every frame."""

    folder: str
    """Sub-folder of the recording."""
    field: str
    """Name in `Capture`."""
    dtype: type[np.generic]
    """Of the image in `Capture`."""
    suffix: str = ".png"
    options: tuple[int, ...] = PNG
    """Of OpenCV's encoder."""
    pack: Callable[[Image], Image] = _as_is
    """From what `Capture` holds to what the file holds."""
    unpack: Callable[[Image], Image] = _as_is
    """The inverse of `pack`."""

    def path(self, index: int) -> str:
        """Where the image of a frame is, relative to the recording."""
        return f"{self.folder}/{index:06d}{self.suffix}"

    def encode(self, image: Image, shape: tuple[int, int]) -> bytes:
        """The bytes of the file.

        Args:
            image: As in `Capture`, shape (H, W).
            shape: The shape (H, W) that it must have.

        Raises:
            RecordingError: The image has another shape or type, or values that the file cannot hold.
        """
        if not self.fits(image, shape):
            raise RecordingError(
                f"{self.field} must be {self.dtype.__name__} of shape {shape}, got {image.dtype} of shape {image.shape}"
            )
        done, data = cv2.imencode(self.suffix, np.ascontiguousarray(self.pack(image)), self.options)
        if not done:
            raise RecordingError(f"OpenCV cannot encode {self.field} as {self.suffix}; install a build that can")
        return data.tobytes()

    def decode(self, data: bytes) -> Image | None:
        """The image that `encode` was given; None if the bytes are no image."""
        stored = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        return None if stored is None else self.unpack(stored)

    def fits(self, image: Image, shape: tuple[int, int]) -> bool:
        """Whether an image has this shape (H, W) and the channel's type."""
        return image.shape == shape and image.dtype == self.dtype


CHANNELS = (
    Channel(folder="gray_left", field="gray_left", dtype=np.uint8),
    Channel(folder="gray_right", field="gray_right", dtype=np.uint8),
    Channel(folder="depth_raw", field="depth_raw_m", dtype=np.float32, suffix=".tiff", options=TIFF_STEPPED),
    Channel(folder="depth_true", field="depth_true_m", dtype=np.float32, suffix=".tiff", options=TIFF_SMOOTH),
    Channel(folder="occluded", field="occluded", dtype=np.bool_, pack=_mask_to_gray, unpack=_gray_to_mask),
    Channel(folder="segment", field="segment_id", dtype=np.int32, pack=_id_to_label, unpack=_label_to_id),
    Channel(folder="invalid_reason", field="invalid_reason", dtype=np.uint8),
)
"""All images of a frame, in the order of their checksums."""
