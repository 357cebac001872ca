"""Images of a dataset. Their headers are checked against the camera and the purpose before they are decoded.

A damaged or hostile file can claim any size: the check keeps the decoder from reserving that much memory. Every reader
raises a `DatasetError` if the file is missing, damaged, or of another kind or size than expected.
"""

from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.TiffImagePlugin import TiffImageFile

from ..errors import DatasetError
from ..types import GrayImage, MaskImage
from .files import read_bytes

ARRAY = ".npy"
DEEP = {("PNG", "I;16"), ("TIFF", "I;16"), ("TIFF", "I;16B"), ("TIFF", "F")}
"""Formats and modes of images with more than 8 bits in one channel."""
SHALLOW = {*(("PNG", mode) for mode in ("L", "LA", "P", "RGB", "RGBA")), ("JPEG", "L"), ("JPEG", "RGB")}
"""Formats and modes of gray and colour images of 8 bits, perhaps with transparency."""
LARGEST_FLOAT_M = 1e5
"""Depth beyond it [m] is none; pictures in colours have larger numbers where they are opaque."""
LARGEST_IMAGE_PX = 2**26
"""Images of more than 67 million pixels are refused."""
_READERS: dict[bytes, Any] = {
    b"\x89PNG": PngImageFile,
    b"\xff\xd8": JpegImageFile,
    b"II*\0": TiffImageFile,
    b"MM\0*": TiffImageFile,
}
"""Readers by the first bytes of a file. `PIL.Image.open` would raise errors of its own about large images."""

Shape = tuple[int, int]


def image_shape(path: Path) -> Shape:
    """Read the shape (H, W) of an image from its header."""
    height_px, width_px = (
        _array(path).shape if path.suffix.lower() == ARRAY else _open(read_bytes(path), path).size[::-1]
    )
    return height_px, width_px


def read_gray(path: Path, shape: Shape) -> GrayImage:
    """Read a PNG or JPEG of 8 bits as a gray image, shape (H, W), uint8, without its colours and transparency."""
    wanted = "a gray or colour image of 8 bits as PNG or JPEG"
    image = _decode(path, shape, wanted, SHALLOW)
    if image.dtype != np.uint8:
        raise DatasetError(f"expected {wanted} in {path}, got {image.dtype}")
    if image.ndim == 2:
        return np.asarray(image, np.uint8)
    has_alpha = image.shape[2] == 4
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGRA2GRAY if has_alpha else cv2.COLOR_BGR2GRAY), np.uint8)


def read_depth(path: Path, shape: Shape) -> npt.NDArray[Any]:
    """Read depth as it is stored, shape (H, W): a PNG, a TIFF or an array of NumPy."""
    if path.suffix.lower() == ARRAY:
        array = _array(path)
        if array.shape != shape:
            raise DatasetError(f"expected an array of shape {shape} in {path}, as the camera has, got {array.shape}")
        return array
    wanted = "depth as a PNG or TIFF of 16 bits or a TIFF of float32, in 1 channel, or the bytes of float32 as RGBA"
    image = _decode(path, shape, wanted, {*DEEP, ("PNG", "RGBA")})
    return image if image.ndim == 2 else _floats(image, path)


def is_deep(path: Path) -> bool:
    """Return whether an image has values of more than 8 bits, as depth has and gray has not."""
    if path.suffix.lower() == ARRAY:
        return True
    header = _open(read_bytes(path), path)
    return (header.format, header.mode) in DEEP


def _floats(image: npt.NDArray[Any], path: Path) -> npt.NDArray[np.float32]:
    """Return the floats of 32 bits whose bytes are the channels of a PNG in OpenCV's order, as TartanAir V2 has."""
    values = np.ascontiguousarray(image).view("<f4")[..., 0].astype(np.float32)
    if image.dtype != np.uint8 or not np.all((values >= 0) & (values < LARGEST_FLOAT_M) | (values == np.inf)):
        raise DatasetError(
            f"expected depth in {path}, got a picture in colours and transparency; choose another folder"
        )
    return values


def _array(path: Path) -> npt.NDArray[Any]:
    """Read an array of NumPy, shape (H, W), of whole numbers or floats of at least 16 bits in any order of bytes."""
    try:
        array = np.load(BytesIO(read_bytes(path)), allow_pickle=False)
    except (ValueError, EOFError, MemoryError) as error:
        raise DatasetError(f"expected an array of NumPy in {path} ({error}); restore the file") from error
    kind = getattr(array, "dtype", np.dtype(object))
    if kind.kind not in "fiu" or kind.itemsize < 2 or array.ndim != 2:
        raise DatasetError(
            f"expected whole numbers or floats of at least 16 bits of shape (H, W) in {path}, got {kind} of shape "
            f"{getattr(array, 'shape', '?')}"
        )
    return np.asarray(array, kind.newbyteorder("="))


def read_depth_16(path: Path, shape: Shape) -> npt.NDArray[np.uint16]:
    """Read a PNG of 16 bits in one channel in its units, shape (H, W), uint16."""
    return np.asarray(_decode(path, shape, "depth as a PNG of 16 bits in 1 channel", {("PNG", "I;16")}), np.uint16)


def read_mask(path: Path, shape: Shape) -> MaskImage:
    """Read a PNG of up to 8 bits in one channel as a mask, True where it is not 0, shape (H, W), bool."""
    wanted = "a mask as a PNG of up to 8 bits in 1 channel"
    return np.asarray(_decode(path, shape, wanted, {("PNG", "1"), ("PNG", "L")}) != 0)


def _open(data: bytes, path: Path) -> Any:
    """Read the header of an image of a reasonable size."""
    image: Any = None
    with suppress(Exception):  # Pillow raises errors of many types for damaged headers
        image = next((reader(BytesIO(data)) for start, reader in _READERS.items() if data.startswith(start)), None)
    if image is None or min(image.size) <= 0:
        raise DatasetError(f"expected an image in {path}, got {len(data)} bytes of something else; restore the file")
    if image.width * image.height > LARGEST_IMAGE_PX:
        raise DatasetError(
            f"{path} claims to be {image.width}x{image.height} pixels, of which at most {LARGEST_IMAGE_PX} "
            "are read; restore the file"
        )
    return image


def _decode(path: Path, shape: Shape, wanted: str, kinds: set[tuple[str, str]]) -> npt.NDArray[Any]:
    """Decode an image whose format and mode, as Pillow names them, are among `kinds`; errors say `wanted`."""
    data = read_bytes(path)
    header = _open(data, path)
    if (header.format, header.mode) not in kinds:
        raise DatasetError(f"expected {wanted} in {path}, got a {header.format} with mode {header.mode}")
    if header.size[::-1] != shape:
        raise DatasetError(
            f"expected {shape[1]}x{shape[0]} pixels in {path}, as the camera's intrinsics say, got "
            f"{header.width}x{header.height}; correct the intrinsics, or export all images in one size"
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DatasetError(f"cannot decode {path} ({error.err or error}); restore the file") from error
    if image is None or image.shape[:2] != shape:
        raise DatasetError(f"{path} is cut short or damaged; restore the file")
    return np.asarray(image)
