"""What an image file says of itself before it is decoded: kind, size, bits and channels.

A damaged or hostile file can claim any size. Reading the claim first keeps the decoder from reserving that much memory.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass

_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_CHANNELS = {0: 1, 2: 3, 3: 3, 4: 2, 6: 4}
"""By colour type; a palette (3) is decoded to three channels."""
_JPEG = b"\xff\xd8"
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers that start a frame (SOF0 to SOF15); the three left out are tables and a reserved code."""
_JPEG_BARE = frozenset({0x01, *range(0xD0, 0xD8)})
"""Markers without a length."""
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_TYPES = {3: "H", 4: "I"}
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_CHANNELS = 256, 257, 258, 277


@dataclass(frozen=True, kw_only=True)
class ImageHeader:
    """What a file claims to hold."""

    kind: str
    """`PNG`, `JPEG` or `TIFF`."""
    width_px: int
    height_px: int
    bits: int
    """Of one channel."""
    channels: int

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape (H, W)."""
        return self.height_px, self.width_px

    def __str__(self) -> str:
        return f"a {self.kind} of {self.bits} bits in {self.channels} channel{'s' if self.channels > 1 else ''}"


def parse_header(data: bytes) -> ImageHeader | None:
    """The header of a PNG, JPEG or TIFF file; None if the bytes are no such file, or end too early."""
    try:
        for parse in _PARSERS:
            header = parse(data)
            if header is not None:
                return header if min(header.shape) > 0 else None
    except (struct.error, IndexError, KeyError):
        pass
    return None


def _parse_png(data: bytes) -> ImageHeader | None:
    if not data.startswith(_PNG) or data[12:16] != b"IHDR":
        return None
    width_px, height_px, bits, colour = struct.unpack_from(">IIBB", data, 16)
    return ImageHeader(
        kind="PNG", width_px=width_px, height_px=height_px, bits=bits, channels=_PNG_CHANNELS[int(colour)]
    )


def _parse_jpeg(data: bytes) -> ImageHeader | None:
    if not data.startswith(_JPEG):
        return None
    at = len(_JPEG)
    while data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _JPEG_FRAMES:
            bits, height_px, width_px, channels = struct.unpack_from(">BHHB", data, at + 4)
            return ImageHeader(kind="JPEG", width_px=width_px, height_px=height_px, bits=bits, channels=channels)
        if marker == 0xFF:  # Padding.
            at += 1
        elif marker in _JPEG_BARE:
            at += 2
        else:
            at += 2 + int(struct.unpack_from(">H", data, at + 2)[0])
    return None


def _parse_tiff(data: bytes) -> ImageHeader | None:
    order = _TIFF.get(data[:4])
    if order is None:
        return None
    start = int(struct.unpack_from(f"{order}I", data, 4)[0])
    n_tags = int(struct.unpack_from(f"{order}H", data, start)[0])
    tags = {_TIFF_BITS: 1, _TIFF_CHANNELS: 1}
    for at in range(start + 2, start + 2 + 12 * n_tags, 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, at)
        if kind in _TIFF_TYPES:
            tags[tag] = int(struct.unpack_from(f"{order}{_TIFF_TYPES[kind]}", data, at + 8)[0])
    return ImageHeader(
        kind="TIFF",
        width_px=tags[_TIFF_WIDTH],
        height_px=tags[_TIFF_HEIGHT],
        bits=tags[_TIFF_BITS],
        channels=tags[_TIFF_CHANNELS],
    )


_PARSERS: tuple[Callable[[bytes], ImageHeader | None], ...] = (_parse_png, _parse_jpeg, _parse_tiff)
