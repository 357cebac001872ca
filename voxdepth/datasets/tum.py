"""TUM RGB-D: two lists of time-stamped images, colour as 8-bit PNG and depth as 16-bit PNG in 1/5000 m.

`rgb.txt` and `depth.txt` hold lines of a time and a file. Colour and depth are matched by nearest time within 20 ms. A
frame has the time of its depth image. `groundtruth.txt` is truth and is not read. Format and intrinsics are those that
the benchmark publishes (Sturm et al., IROS 2012, doi:10.1109/IROS.2012.6385773); the images of freiburg1 and freiburg2
have a lens distortion that is left in.
"""

import re
import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import DatasetError
from ..types import Intrinsics
from ..units import Unit
from .files import CALIBRATION, no_camera, path_inside, read_text
from .images import image_shape
from .pairs import Pair, PairedImages, parse_stamp

COLOUR_LIST, DEPTH_LIST = "rgb.txt", "depth.txt"
UNIT = Unit(5000, is_known=False, least_m=0.4, convention="TUM RGB-D has it")
"""Of the benchmark, whose camera measures nothing nearer."""
SAME_CAMERA = 0.05
"""Relative difference of the focal lengths of one camera that two people calibrated."""
_SHAPE = (480, 640)
_FOCAL_AND_CENTRE_PX = {
    "1": (517.3, 516.5, 318.6, 255.3),
    "2": (520.9, 521.0, 325.1, 249.7),
    "3": (535.4, 539.2, 320.1, 247.6),
}
_ROS_DEFAULT_PX = (525.0, 525.0, 319.5, 239.5)
_CAMERA = re.compile(r"(?<![a-z])fr(?:eiburg)?([123])(?!\d)", re.IGNORECASE)


class TumDataset(PairedImages):
    """A sequence in the format of the TUM RGB-D benchmark."""

    format = "tum"
    unit = UNIT
    _is_assumed = False
    """Whether the camera is that of the benchmark because nobody states another one."""

    def __init__(self, folder: Path, intrinsics: Intrinsics | None = None, **options: Any) -> None:
        self._camera = _camera_of(folder)
        super().__init__(folder, intrinsics, **options)
        if self.unit is UNIT and not (self._camera and self._is_of(self._camera)):
            warnings.warn(
                f"{folder} is taken to have depth in steps of 1/{UNIT.units_per_m:g} m, as TUM RGB-D has, though its "
                f"{'camera' if self._camera else 'name'} is none of that: state units_per_m in {CALIBRATION} or as "
                "--units-per-m, 1000 for millimetres",
                stacklevel=2,
            )
            self.unit = replace(UNIT, convention="")

    @classmethod
    def missing(cls, folder: Path) -> str:
        """See `PairedImages`."""
        return " and ".join(name for name in (COLOUR_LIST, DEPTH_LIST) if not (folder / name).exists())

    def _find_pairs(self, folder: Path) -> list[Pair]:
        depth, colour = folder / DEPTH_LIST, folder / COLOUR_LIST
        return self._matched(_listed(depth), _listed(colour), str(depth), str(colour))

    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        height_px, width_px = shape = image_shape(first.depth)
        if shape != _SHAPE:
            reason = f"the images of {folder} are {width_px}x{height_px}, and only the camera of 640x480 is known"
            raise no_camera(reason, folder, shape)
        fx_px, fy_px, cx_px, cy_px = _FOCAL_AND_CENTRE_PX.get(self._camera, _ROS_DEFAULT_PX)
        self._is_assumed = not self._camera
        return Intrinsics(fx_px=fx_px, fy_px=fy_px, cx_px=cx_px, cy_px=cy_px, width_px=width_px, height_px=height_px)

    def assumed(self) -> Iterator[str]:
        """See `Dataset`."""
        if self._is_assumed:
            yield (
                f"is taken for a sequence of TUM RGB-D with a focal length of {_ROS_DEFAULT_PX[0]:g} px; state the "
                f"camera in its {CALIBRATION} if it is another one"
            )
        yield from super().assumed()

    def _is_of(self, camera: str) -> bool:
        """Return whether the intrinsics are those of a camera of the benchmark, perhaps in images of another size."""
        given, published = (
            fx_px / width_px
            for fx_px, width_px in (
                (self.intrinsics.fx_px, self.intrinsics.width_px),
                (_FOCAL_AND_CENTRE_PX[camera][0], _SHAPE[1]),
            )
        )
        return abs(given / published - 1) < SAME_CAMERA


def _camera_of(folder: Path) -> str:
    """Return the camera of the benchmark that the name of a folder tells, or that of what it links to; else empty."""
    found = _CAMERA.search(folder.name) or _CAMERA.search(folder.resolve().name)
    return found[1] if found else ""


def _listed(path: Path) -> list[tuple[float, Path]]:
    """Return the time [s] and the file of every line that is no comment."""
    entries = []
    for number, line in enumerate(read_text(path, has_names=True).split("\n"), 1):
        words = line.split()
        if not words or words[0].startswith("#"):
            continue
        source = f"line {number} of {path}"
        if len(words) != 2:
            raise DatasetError(f"expected a time and a file in {source}, got {line[:80]!r}")
        entries.append((parse_stamp(words[0], source), path_inside(path.parent, words[1], source)))
    return entries
