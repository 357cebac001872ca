"""Laws of reading images: values come back exactly, and what a file claims is checked before it is decoded."""

import struct
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from tests.sequences import SHAPE, encoded
from voxdepth.datasets import images
from voxdepth.datasets.images import image_shape, read_depth, read_depth_16, read_gray
from voxdepth.errors import DatasetError

RNG = np.random.default_rng(7)
DEPTH_16 = RNG.integers(0, 65536, SHAPE, np.uint16)
GRAY = RNG.integers(0, 256, SHAPE, np.uint8)
COLOUR = RNG.integers(0, 256, (*SHAPE, 3), np.uint8)
DEPTH_M = RNG.uniform(0, 9, SHAPE).astype(np.float32)


def written(folder: Path, image: Any, suffix: str = ".png") -> Path:
    path = folder / f"image{suffix}"
    path.write_bytes(encoded(image, suffix))
    return path


def huge_png() -> bytes:
    header = b"IHDR" + struct.pack(">IIBBBBB", 100_000, 100_000, 16, 0, 0, 0, 0)
    first = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))
    return first + struct.pack(">I", 10) + b"IDAT" + bytes(10)


def huge_jpeg() -> bytes:
    data = encoded(GRAY, ".jpg")
    at = data.index(b"\xff\xc0") + 5
    return data[:at] + struct.pack(">HH", 65_500, 65_500) + data[at + 4 :]


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_gray_reads_back_exactly_and_colour_as_opencv_makes_it_gray(tmp_path: Path, suffix: str) -> None:
    for image in (GRAY, COLOUR):
        path = written(tmp_path, image, suffix)
        stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        gray = read_gray(path, SHAPE)
        assert gray.dtype == np.uint8 and image_shape(path) == SHAPE
        assert np.array_equal(gray, stored if image is GRAY else cv2.cvtColor(stored, cv2.COLOR_BGR2GRAY))


@pytest.mark.parametrize(("image", "suffix"), [(DEPTH_M, ".tiff"), (DEPTH_16, ".tiff"), (DEPTH_16, ".png")])
def test_depth_reads_back_exactly(tmp_path: Path, image: Any, suffix: str) -> None:
    path = written(tmp_path, image, suffix)
    assert np.array_equal(read_depth(path, SHAPE), image) and image_shape(path) == SHAPE


@pytest.mark.parametrize("kind", ["<f2", ">f2", ">f4", ">f8", "<u2", ">u2", "<i4", ">u4"])
def test_an_array_reads_back_in_the_byte_order_of_this_machine(tmp_path: Path, kind: str) -> None:
    stored = (100 * DEPTH_M).astype(kind)
    np.save(tmp_path / "depth.npy", stored)
    read = read_depth(tmp_path / "depth.npy", SHAPE)
    assert read.dtype.isnative and np.array_equal(read, stored) and image_shape(tmp_path / "depth.npy") == SHAPE


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (GRAY, r"at least 16 bits .*depth\.npy, got uint8"),
        (DEPTH_16[..., None], r"of shape \(H, W\) .* got uint16 of shape \(6, 8, 1\)"),
        (DEPTH_M > 1, "got bool"),
        (DEPTH_M[:, :5], r"expected an array of shape \(6, 8\) .* got \(6, 5\)"),
        (np.array([{}]), "expected an array of NumPy"),
    ],
)
def test_an_array_that_is_no_depth_is_refused(tmp_path: Path, array: Any, message: str) -> None:
    np.save(tmp_path / "depth.npy", array)
    with pytest.raises(DatasetError, match=message):
        read_depth(tmp_path / "depth.npy", SHAPE)


@given(st.integers(0, 300))
def test_an_array_that_is_cut_short_is_refused(tmp_path_factory: pytest.TempPathFactory, kept: int) -> None:
    path = tmp_path_factory.getbasetemp() / "cut.npy"
    np.save(path, DEPTH_M)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(DatasetError, match=r"cut\.npy"):
        read_depth(path, SHAPE)


@given(st.data(), st.sampled_from([(GRAY, ".png"), (COLOUR, ".jpg"), (DEPTH_M, ".tiff")]))
def test_a_header_that_is_cut_short_is_refused_or_right(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, kind: tuple[Any, str]
) -> None:
    whole, path = encoded(*kind), tmp_path_factory.getbasetemp() / "cut"
    path.write_bytes(whole[: data.draw(st.integers(0, len(whole)))])
    with suppress(DatasetError):
        assert image_shape(path) == SHAPE


@pytest.mark.parametrize("make", [huge_png, huge_jpeg])
def test_an_image_that_claims_to_be_huge_is_never_decoded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[[], bytes]
) -> None:
    path = tmp_path / "huge.png"
    path.write_bytes(make())
    monkeypatch.setattr(images.cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    for read in (read_gray, read_depth_16):
        with pytest.raises(DatasetError, match=r"huge\.png claims to be \d+x\d+ pixels"):
            read(path, (100_000, 100_000))
    with pytest.raises(DatasetError, match="claims to be"):
        image_shape(path)


def test_an_image_of_another_size_is_never_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(images.cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(DatasetError, match=r"expected 9x6 pixels in .*image\.png.* got 8x6"):
        read_depth_16(written(tmp_path, DEPTH_16), (6, 9))


@pytest.mark.parametrize(
    ("read", "image", "suffix", "wanted"),
    [
        (read_depth_16, GRAY, ".png", "depth as a PNG of 16 bits in 1 channel"),
        (read_depth_16, COLOUR, ".png", "depth as a PNG of 16 bits in 1 channel"),
        (read_depth_16, COLOUR.astype(np.uint16), ".png", "depth as a PNG of 16 bits in 1 channel"),
        (read_depth, DEPTH_M.astype(np.int32), ".tiff", "depth as .* float32"),
        (read_gray, DEPTH_16, ".png", "a gray or colour image of 8 bits"),
        (read_gray, COLOUR.astype(np.uint16) * 257, ".png", "a gray or colour image of 8 bits"),
    ],
)
def test_an_image_of_another_kind_is_refused(
    tmp_path: Path, read: Callable[..., Any], image: Any, suffix: str, wanted: str
) -> None:
    with pytest.raises(DatasetError, match=rf"expected {wanted}.* in .*image\{suffix}"):
        read(written(tmp_path, image, suffix), SHAPE)


def test_a_gray_image_is_the_same_with_transparency(tmp_path: Path) -> None:
    expected = read_gray(written(tmp_path, COLOUR), SHAPE)
    for alpha in (GRAY, np.zeros_like(GRAY)):
        np.testing.assert_array_equal(read_gray(written(tmp_path, np.dstack([COLOUR, alpha])), SHAPE), expected)
    path = tmp_path / "LA.png"
    Image.merge("LA", [Image.fromarray(GRAY), Image.fromarray(255 - GRAY)]).save(path)
    np.testing.assert_array_equal(read_gray(path, SHAPE), GRAY)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.8])
def test_an_image_that_is_cut_short_is_refused(tmp_path: Path, suffix: str, kept: float) -> None:
    noise = RNG.integers(0, 256, (60, 80), np.uint8)
    data = encoded(noise, suffix)
    path = tmp_path / f"image{suffix}"
    path.write_bytes(data[: int(len(data) * kept)])
    with pytest.raises(DatasetError, match=rf"image\{suffix}"):
        read_gray(path, noise.shape)


def test_a_damaged_png_is_refused(tmp_path: Path) -> None:
    data = bytearray(encoded(RNG.integers(0, 65536, (60, 80), np.uint16)))
    data[len(data) // 2] ^= 0xFF
    (tmp_path / "image.png").write_bytes(data)
    with pytest.raises(DatasetError, match=r"image\.png"):
        read_depth_16(tmp_path / "image.png", (60, 80))


def test_what_is_no_plain_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(DatasetError, match=r"expected a file .*none\.png, got none"):
        read_gray(tmp_path / "none.png", SHAPE)
    with pytest.raises(DatasetError, match="got something else"):
        read_gray(tmp_path, SHAPE)
    path = written(tmp_path, GRAY)
    monkeypatch.setattr("voxdepth.datasets.files.LARGEST_FILE_BYTES", 10)
    with pytest.raises(DatasetError, match=r"at most 10 bytes in .*image\.png"):
        read_gray(path, SHAPE)
    monkeypatch.undo()

    def refuse(path: Path) -> bytes:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "read_bytes", refuse)
    with pytest.raises(DatasetError, match=r"cannot read .*image\.png: Permission denied"):
        read_gray(path, SHAPE)
