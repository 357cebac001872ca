"""RealSense exports: depth of 16 bits that is aligned with a colour or infrared image, as other tools store it.

Two layouts are read. Open3D's recorder and its bag reader write the first: a folder `depth` of 16-bit PNG beside one of
gray or colour images, `color`, `rgb`, `infra1` or `ir` in this order of precedence. `camera_intrinsic.json` or
`intrinsic.json` describes the camera by `width`, `height`, `intrinsic_matrix` by columns, and perhaps `fps` and
`depth_scale` (units in a metre, or RealSense's metres in a unit, which are below 1). The default unit is 1 mm, as in
all cameras but the D405, whose unit is 0.1 mm. Files of one frame have the same number in their names. A number with a
decimal point or of at least 13 digits is a time, in s, ms, us or ns by its size; a shorter one counts frames, at `fps`
or else 30 a second. Streams with different times are matched within 20 ms.

The second is the output of `rs-convert -r P -p P`, the converter of recordings (tools/convert in librealsense):
`P_Depth_MS.raw` (16-bit depth), `P_Infrared 1_MS.png` (gray) and more, where MS is the time of capture in milliseconds.
It does not describe the camera: write a `calibration.toml`. Depth and the left infrared image, `Infrared 1` or
`Infrared`, have the same view and size. Colour has another view, since the converter aligns nothing, and the PNG of
depth is in false colours: neither can be used. Single frames that the Viewer saves are no stream and are not read.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DatasetError
from ..types import FloatImage, Intrinsics
from . import WITHIN_S
from .files import CALIBRATION, as_number, intrinsics_from, list_folder, list_images, read_text
from .images import image_shape, read_depth_16, read_depth_raw
from .pairs import Pair, PairedImages, associate, matched, require_increasing

DEPTH = "depth"
GRAYS = ("color", "rgb", "infra1", "ir")
METADATA = ("camera_intrinsic.json", "intrinsic.json")
UNITS_PER_M = 1000.0
RATE_HZ = 30.0
_NUMBER = re.compile(r"(?:.*[^0-9.])?([0-9]{1,24}(?:\.[0-9]{1,24})?)", re.DOTALL)
_UNITS_PER_S = ((1e17, 1e9), (1e14, 1e6), (1e11, 1e3))
"""From which number on a time of our age is in ns, us or ms; below, it is in seconds."""

_CONVERTED = re.compile(r".*_(Depth|Infrared|Infrared 1|Color)_([0-9]+(?:\.[0-9]+)?)\.(raw|png)", re.DOTALL)
_DEPTH, _INFRARED = [("Depth", "raw")], [("Infrared", "png"), ("Infrared 1", "png")]


class RealSenseDataset(PairedImages):
    """Frames exported of a RealSense camera."""

    format = "realsense"

    def __init__(self, folder: Path, intrinsics: Intrinsics | None = None, *, within_s: float = WITHIN_S) -> None:
        self._metadata_path, self._metadata = _read_metadata(folder)
        scale = self._positive("depth_scale", UNITS_PER_M)
        self._units_per_m = 1 / scale if scale < 1 else scale
        super().__init__(folder, intrinsics, within_s=within_s)
        pair = self._pairs[0]
        if pair.depth.suffix != ".raw" and (depth := image_shape(pair.depth)) != (gray := image_shape(pair.gray)):
            raise DatasetError(
                f"{pair.depth} is {depth[1]}x{depth[0]} and {pair.gray} is {gray[1]}x{gray[0]}; "
                "align depth with the other stream when exporting"
            )

    @classmethod
    def lacking(cls, folder: Path) -> str:
        """See `PairedImages`."""
        lists = [name for name in ("rgb.txt", "depth.txt") if (folder / name).exists()]
        if lists:
            return f"nothing, but it has {' and '.join(lists)} of TUM RGB-D, whose depth has other units"
        is_converted = any(_CONVERTED.fullmatch(path.name) for path in list_folder(folder))
        if is_converted or ((folder / DEPTH).is_dir() and _gray_folder(folder)):
            return ""
        return f"folders {DEPTH} and {' or '.join(GRAYS)} (or *_Depth_*.raw of rs-convert)"

    def _find_pairs(self, folder: Path) -> list[Pair]:
        gray = _gray_folder(folder)
        if gray is None:
            return _converted_pairs(folder, self._within_s)
        return _paired(folder / DEPTH, gray, self._positive("fps", RATE_HZ), self._within_s)

    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        """The camera of `intrinsic_matrix`, `width` and `height` in the metadata."""
        path, metadata = self._metadata_path, self._metadata
        if not metadata:
            raise DatasetError(
                f"expected the camera in {CALIBRATION} or {' or '.join(METADATA)} in {folder}, got none; "
                "write one of them"
            )
        matrix = metadata.get("intrinsic_matrix")
        if not isinstance(matrix, list) or len(matrix) != 9:
            raise DatasetError(f"expected an intrinsic_matrix of 9 numbers in {path}, got {str(matrix)[:80]}")
        fx, a, b, skew, fy, c, cx, cy, one = matrix
        if [a, b, skew, c, one] != [0, 0, 0, 0, 1]:
            raise DatasetError(
                f"expected intrinsic_matrix by columns, [fx, 0, 0, 0, fy, 0, cx, cy, 1], in {path}: {matrix}"
            )
        values = {"fx_px": fx, "fy_px": fy, "cx_px": cx, "cy_px": cy}
        sizes = {f"{side}_px": metadata.get(side) for side in ("width", "height")}
        return intrinsics_from({**values, **sizes}, path)

    def _positive(self, key: str, default: float) -> float:
        number = as_number(self._metadata.get(key, default))
        if number is None or number <= 0:
            given = str(self._metadata[key])[:80]
            raise DatasetError(f"expected a positive number for {key} in {self._metadata_path}, got {given}")
        return number

    def _read_depth_m(self, pair: Pair) -> FloatImage:
        read = read_depth_raw if pair.depth.suffix == ".raw" else read_depth_16
        return (read(pair.depth, self.intrinsics.shape) / self._units_per_m).astype(np.float32)


def _gray_folder(folder: Path) -> Path | None:
    return next((folder / name for name in GRAYS if (folder / name).is_dir()), None)


def _paired(depth_folder: Path, gray_folder: Path, rate_hz: float, within_s: float) -> list[Pair]:
    """Files of one number, or else of nearest time."""
    depth, gray = _by_number(depth_folder, (".png",)), _by_number(gray_folder, (".png", ".jpg", ".jpeg"))
    stamps_s = _stamps(depth_folder, depth, rate_hz)
    keys = [(key, key) for key in depth if key in gray]
    if len(keys) < max(len(depth), len(gray)) and all(map(_is_time, [*depth, *gray])):
        gray_s = _stamps(gray_folder, gray, rate_hz)
        matches = associate(list(stamps_s.values()), list(gray_s.values()), within_s=within_s)
        keys = [(list(depth)[i], list(gray)[j]) for i, j in matches]
    elif keys and (alone := [depth.get(number) or gray[number] for number in depth.keys() ^ gray.keys()]):
        raise DatasetError(
            f"expected a depth and a gray image of each number, got {min(alone)} alone and {len(alone) - 1} others; "
            "restore what is missing, as PNG if it is depth, or move what is alone away"
        )
    if not keys:
        raise DatasetError(
            f"expected images of the same numbers in {depth_folder} (16-bit PNG, no other format) and {gray_folder} "
            f"(PNG or JPEG), got none among {len(depth)} and {len(gray)}; name the files of a frame alike"
        )
    return [Pair(stamp_s=stamps_s[i], gray=gray[j], depth=depth[i]) for i, j in keys]


def _by_number(folder: Path, suffixes: tuple[str, ...]) -> dict[str, Path]:
    """Files by the number in their names, in the order of the numbers."""
    files: dict[str, Path] = {}
    for path in list_images(folder, suffixes):
        match = _NUMBER.fullmatch(path.stem)
        if match is None:
            raise DatasetError(f"expected a number at the end of the name of {path}; number the frames")
        if match[1] in files:
            raise DatasetError(f"{files[match[1]]} and {path} have one number; keep one of them")
        files[match[1]] = path
    return dict(sorted(files.items(), key=lambda item: float(item[0])))


def _is_time(number: str) -> bool:
    return "." in number or len(number) >= 13


def _stamps(folder: Path, files: dict[str, Path], rate_hz: float) -> dict[str, float]:
    """Time of each file [s], by its number."""
    stamps_s = {number: float(number) for number in files}
    if all(map(_is_time, files)):
        for number, time in stamps_s.items():
            stamps_s[number] = time / next((per_s for least, per_s in _UNITS_PER_S if time >= least), 1.0)
    else:
        stamps_s = {number: count * (1 / rate_hz) for number, count in stamps_s.items()}
    require_increasing(list(stamps_s.values()), f"the names of the {len(files)} files in {folder}")
    return stamps_s


def _read_metadata(folder: Path) -> tuple[Path, Mapping[str, Any]]:
    """The description of the camera by Open3D's tools; empty without one."""
    path = next((folder / name for name in METADATA if (folder / name).exists()), folder / METADATA[0])
    if not path.exists():
        return path, {}
    try:
        metadata = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{path} is no JSON ({error}); restore it") from error
    if not isinstance(metadata, dict):
        raise DatasetError(f"expected a JSON object in {path}, got {type(metadata).__name__}; restore it")
    return path, metadata


def _converted_pairs(folder: Path, within_s: float) -> list[Pair]:
    """Depth and infrared images of nearest time that the converter wrote."""
    depth, infrared = _stream(folder, _DEPTH), _stream(folder, _INFRARED)
    if not depth:
        raise DatasetError(f"expected *_Depth_*.raw in {folder}, got none; run rs-convert with -r: its PNG is no depth")
    if not infrared:
        raise DatasetError(
            f"expected *_Infrared*_*.png in {folder}, got none; run rs-convert with -p. Colour is not aligned with the "
            "depth: to use it, align when exporting, and store the images in folders depth and color"
        )
    sources = f"depth in the file names of {folder}", "infrared in them"
    frames = matched(depth, infrared, *sources, within_s=within_s)
    return [Pair(stamp_s=stamp_s, gray=gray, depth=raw) for stamp_s, raw, gray in frames]


def _stream(folder: Path, kinds: Sequence[tuple[str, str]]) -> list[tuple[float, Path]]:
    """Times [s] and files, in order."""
    matches = ((path, _CONVERTED.fullmatch(path.name)) for path in list_folder(folder))
    return sorted((float(m[2]) / 1000, path) for path, m in matches if m and (m[1], m[3]) in kinds)
