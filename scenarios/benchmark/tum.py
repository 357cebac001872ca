"""A clip as files: what a pipeline has to read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from sim.recording.calibration import CALIBRATION, calibration_toml
from voxdepth.types import FloatImage

from .clip import RATE_HZ, Clip

UNITS_PER_M = 5000.0


def write_tum(clip: Clip, folder: Path, frames: int) -> None:
    """The frames of `Clip.play` in the format of TUM RGB-D, whose depth ends at 13.1 m; what is beyond is left empty.

    Every image is written once; the frames that repeat it are further names of its file.

    Args:
        clip: What is played; of a camera with a baseline.
        folder: A new one.
        frames: How many.
    """
    units = [depth_units(depth_m) for depth_m in clip.depths_m]
    kinds: dict[str, Sequence[npt.NDArray[Any]]] = {"rgb": clip.grays, "depth": units}
    for kind, images in kinds.items():
        (folder / kind).mkdir(parents=True)
        lines = []
        for k, index in enumerate(clip.indices(frames)):
            name = f"{kind}/{k:06d}.png"
            if k == index:
                cv2.imwrite(str(folder / name), images[index])
            else:
                (folder / name).hardlink_to(folder / kind / f"{index:06d}.png")
            lines.append(f"{k / RATE_HZ:.6f} {name}\n")
        (folder / f"{kind}.txt").write_text("".join(lines), encoding="utf-8")
    (folder / CALIBRATION).write_text(calibration_toml(clip.intrinsics), encoding="utf-8")


def depth_units(depth_m: FloatImage) -> npt.NDArray[np.uint16]:
    """Depth in steps of 1/5000 m, shape (H, W); 0 where there is none or it does not fit into 16 bits."""
    units = np.rint(depth_m * np.float32(UNITS_PER_M))
    return np.where(units < 2**16, units, 0).astype(np.uint16)
