"""Images of a small camera, and folders with them as strangers bring them."""

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np

from voxdepth.types import Intrinsics

SHAPE = (6, 8)
CAMERA = Intrinsics(fx_px=9.5, fy_px=9.25, cx_px=3.5, cy_px=2.5, width_px=8, height_px=6)


def depth_of(index: int) -> np.ndarray:
    """Depth of a frame in units, shape (6, 8), uint16."""
    return np.random.default_rng(index).integers(0, 65536, SHAPE, np.uint16)


def gray_of(index: int) -> np.ndarray:
    """The gray image of a frame, shape (6, 8), uint8."""
    return np.random.default_rng(90 + index).integers(0, 256, SHAPE, np.uint8)


def encoded(pixels: np.ndarray, suffix: str = ".png") -> bytes:
    """An image as the content of a file."""
    return cv2.imencode(suffix, pixels)[1].tobytes()


def write_images(folder: Path, images: Mapping[str, np.ndarray]) -> None:
    """Write images by their names in a folder."""
    for name, pixels in images.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, pixels) if path.suffix == ".npy" else path.write_bytes(encoded(pixels, path.suffix))


def toml_of(camera: Intrinsics) -> str:
    """A camera as `calibration.toml` states it."""
    return "".join(f"{name} = {value}\n" for name, value in asdict(camera).items() if value is not None)
