"""Images of a dataset, checked before they are decoded: the file's own header must fit the camera and the purpose."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..errors import DatasetError
from ..types import FloatImage, GrayImage, MaskImage
from .files import read_bytes
from .headers import ImageHeader, parse_header

LARGEST_IMAGE_PX = 2**26
"""Larger images than 67 million pixels are refused unread."""

Depth16 = npt.NDArray[np.uint16]
Shape = tuple[int, int]


def image_shape(path: Path) -> Shape:
    """Shape (H, W) that an image claims to have; it is not decoded.

    Raises:
        DatasetError: It cannot be read, is no image, or is unreasonably large.
    """
    return _header(read_bytes(path), path).shape


def read_gray(path: Path, shape: Shape) -> GrayImage:
    """A gray image, or a colour image made gray.

    Args:
        path: A PNG or JPEG of 8 bits in one channel or three.
        shape: Shape (H, W) that it must have.

    Returns:
        Shape (H, W), uint8.

    Raises:
        DatasetError: The file is missing, damaged, of another kind or size.
    """
    return decode_gray(read_bytes(path), path, shape)


def decode_gray(data: bytes, path: Path, shape: Shape) -> GrayImage:
    """The same, of bytes that were read from `path`.

    Raises:
        DatasetError: They are damaged, of another kind or size.
    """
    image = _decode(
        data,
        path,
        shape,
        "a gray or colour image of 8 bits as PNG or JPEG",
        lambda header: header.kind != "TIFF" and header.bits == 8 and header.channels in (1, 3),
    )
    return np.asarray(image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def read_depth_16(path: Path, shape: Shape) -> Depth16:
    """A depth image of 16 bits, as stored.

    Args:
        path: A PNG of 16 bits in one channel.
        shape: Shape (H, W) that it must have.

    Returns:
        Shape (H, W), uint16.

    Raises:
        DatasetError: The file is missing, damaged, of another kind or size.
    """
    image = _decode(
        read_bytes(path),
        path,
        shape,
        "depth as a PNG of 16 bits in 1 channel",
        lambda header: (header.kind, header.bits, header.channels) == ("PNG", 16, 1),
    )
    return np.asarray(image, np.uint16)


def read_depth_raw(path: Path, shape: Shape) -> Depth16:
    """A depth image of 16 bits without a header: rows of little-endian numbers.

    Args:
        path: A file of 2 H W bytes.
        shape: Shape (H, W) that it must have.

    Returns:
        Shape (H, W), uint16.

    Raises:
        DatasetError: The file is missing or of another size.
    """
    data = read_bytes(path)
    if len(data) != 2 * shape[0] * shape[1]:
        raise DatasetError(
            f"expected {2 * shape[0] * shape[1]} bytes of depth in {path}, 16 bits for each of "
            f"{shape[1]}x{shape[0]} pixels, got {len(data)}; export it again"
        )
    return np.frombuffer(data, "<u2").reshape(shape).astype(np.uint16)


def read_mask(path: Path, shape: Shape) -> MaskImage:
    """A mask: True where the image is not 0.

    Args:
        path: A PNG of up to 8 bits in one channel.
        shape: Shape (H, W) that it must have.

    Returns:
        Shape (H, W), bool.

    Raises:
        DatasetError: The file is missing, damaged, of another kind or size.
    """
    image = _decode(
        read_bytes(path),
        path,
        shape,
        "a mask as a PNG of up to 8 bits in 1 channel",
        lambda header: header.kind == "PNG" and header.bits <= 8 and header.channels == 1,
    )
    return np.asarray(image != 0)


def decode_depth_m(data: bytes, path: Path, shape: Shape) -> FloatImage:
    """A depth image in metres.

    Args:
        data: Of a TIFF of 32-bit floats in one channel.
        path: Where it was read, for the error.
        shape: Shape (H, W) that it must have.

    Returns:
        Shape (H, W), float32 [m], finite and not negative.

    Raises:
        DatasetError: It is damaged, of another kind or size, or holds values that are no depth.
    """
    image = _decode(
        data,
        path,
        shape,
        "depth as a TIFF of 32 bits in 1 channel",
        lambda header: (header.kind, header.bits, header.channels) == ("TIFF", 32, 1),
    )
    if image.dtype != np.float32:
        raise DatasetError(f"expected depth in metres as float32 in {path}, got {image.dtype}; export it again")
    require_depths(image, path)
    return np.asarray(image, np.float32)


def require_depths(depth: npt.NDArray[np.floating[Any]], path: Path) -> None:
    """Refuse what no camera measures.

    Raises:
        DatasetError: There are values that are NaN, infinite or negative.
    """
    low, high = float(depth.min()), float(depth.max())
    if not (low >= 0 and high < np.inf):
        raise DatasetError(
            f"expected finite values of at least 0 in {path}, got values from {low} to {high}; 0 stands for no depth"
        )


def _header(data: bytes, path: Path) -> ImageHeader:
    header = parse_header(data)
    if header is None:
        raise DatasetError(f"expected an image in {path}, got {len(data)} bytes of something else; restore the file")
    if header.width_px * header.height_px > LARGEST_IMAGE_PX:
        raise DatasetError(
            f"{path} claims to be {header.width_px}x{header.height_px} pixels, of which at most {LARGEST_IMAGE_PX} "
            "are read; restore the file"
        )
    return header


def _decode(
    data: bytes, path: Path, shape: Shape, wanted: str, fits: Callable[[ImageHeader], bool]
) -> npt.NDArray[Any]:
    """The pixels, once the header says what is wanted; `wanted` is for the error."""
    header = _header(data, path)
    if not fits(header):
        raise DatasetError(f"expected {wanted} in {path}, got {header}")
    if header.shape != shape:
        raise DatasetError(
            f"expected {shape[1]}x{shape[0]} pixels in {path}, as the camera's intrinsics say, got "
            f"{header.width_px}x{header.height_px}; correct the intrinsics, or export all images in one size"
        )
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise DatasetError(f"cannot decode {path} ({error.err or error}); restore the file") from error
    if image is None or image.shape[:2] != shape:
        raise DatasetError(f"{path} is cut short or damaged; restore the file")
    return np.asarray(image)
