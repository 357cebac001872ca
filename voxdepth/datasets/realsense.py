"""RealSense exports: depth of 16 bits that is aligned with a colour or infrared image, as other tools store it.

Open3D's recorder and its bag reader write a folder `depth` of 16-bit PNG beside one of gray or colour images, `color`;
other names of both are in `DEPTHS` and `GRAYS`, in order of precedence. `camera_intrinsic.json` or `intrinsic.json`
describes the camera by `width`, `height`, `intrinsic_matrix` by columns, and perhaps `fps` and `depth_scale` (units in
a metre, or RealSense's metres in a unit, which are below 1). The default unit is 1 mm, as in all cameras but the D405,
whose unit is 0.1 mm. Files of one frame have the same number in their names, which counts frames, at `fps` or else 30 a
second, or times within 20 ms of each other, see `voxdepth.datasets.names`. Depth may also be a TIFF of 16 bits or of
floats in metres, or an array of NumPy.
"""

import json
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..errors import DatasetError
from ..types import Intrinsics
from ..units import Unit
from .files import CALIBRATION, intrinsics_from, list_folder, list_images, no_camera, read_text
from .images import image_shape, is_deep
from .names import in_order
from .pairs import Pair, PairedImages

DEPTHS = ("depth", "depths", "depth_left", "depth_images")
GRAYS = (
    *("color", "colour", "colors", "rgb", "gray", "grey", "infra1", "ir"),
    *("left", "image", "images", "image_left", "color_left", "gray_left"),
)
"""Names of the folders of depth and of gray or colour images, in lower case."""
METADATA = ("camera_intrinsic.json", "intrinsic.json")
DEPTH_SUFFIXES = (".png", ".tiff", ".tif", ".npy")
GRAY_SUFFIXES = (".png", ".jpg", ".jpeg")
RATE_HZ = 30.0
LARGEST = 1e12
"""Larger numbers in the metadata make no sense."""


class RealSenseDataset(PairedImages):
    """Frames exported of a RealSense camera."""

    format = "realsense"
    unit = Unit(convention="most cameras have it", may_be_halves=True)

    def __init__(self, folder: Path, intrinsics: Intrinsics | None = None, **options: Any) -> None:
        self._metadata_path, self._metadata = _read_metadata(folder)
        if "depth_scale" in self._metadata:
            scale = self._positive("depth_scale")
            self.unit = Unit(1 / scale if scale < 1 else scale)
        super().__init__(folder, intrinsics, **options)
        pair = self._pairs[0]
        if is_deep(pair.gray) and not is_deep(pair.depth):
            raise DatasetError(
                f"{pair.gray} has 16 bits, as depth has, and {pair.depth} has 8, as images have: exchange the names of "
                f"the folders {pair.gray.parent.name} and {pair.depth.parent.name}"
            )
        if (depth := image_shape(pair.depth)) != (gray := image_shape(pair.gray)):
            raise DatasetError(
                f"{pair.depth} is {depth[1]}x{depth[0]} and {pair.gray} is {gray[1]}x{gray[0]}; "
                "align depth with the other stream when exporting"
            )

    @classmethod
    def missing(cls, folder: Path) -> str:
        """See `PairedImages`."""
        lists = [name for name in ("rgb.txt", "depth.txt", "associations.txt") if (folder / name).exists()]
        if lists:
            had = f"nothing, but it has {' and '.join(lists)} of TUM RGB-D, whose depth has other units"
            return f"{had}: write both rgb.txt and depth.txt, or none of these"
        if _named(folder, DEPTHS) and _named(folder, GRAYS):
            return ""
        return f"a folder of depth ({', '.join(DEPTHS)}) and one of images ({', '.join(GRAYS)})"

    def _find_pairs(self, folder: Path) -> list[Pair]:
        """Return the files of one number, or of nearest time."""
        depth_folder, gray_folder = (_named(folder, names) or folder / names[0] for names in (DEPTHS, GRAYS))
        if others := [path.name for path in _all_named(folder, GRAYS) if path != gray_folder]:
            warnings.warn(
                f"{gray_folder} is taken for the images in whose view the depth is, and not {', '.join(others)}: if it "
                "is another, put that and the depth alone into a folder",
                stacklevel=3,
            )
        depth, gray = in_order(_depth_files(depth_folder)), in_order(list_images(gray_folder, GRAY_SUFFIXES))
        if depth.are_times and gray.are_times:
            depth_s, gray_s = ([(time_ns / 1e9, path) for time_ns, path in each.files] for each in (depth, gray))
            return self._matched(depth_s, gray_s, f"the names in {depth_folder}", f"the names in {gray_folder}")
        depths, grays = dict(depth.files), dict(gray.files)
        if depth.are_times != gray.are_times or not depths.keys() & grays.keys():
            raise DatasetError(
                f"expected images of the same numbers or times in {depth_folder} ({', '.join(DEPTH_SUFFIXES)}) and "
                f"{gray_folder} ({', '.join(GRAY_SUFFIXES)}), got none among {len(depths)} and {len(grays)} of "
                f"{len(list_folder(depth_folder))} and {len(list_folder(gray_folder))} files; name the images of a "
                "frame alike, in these formats"
            )
        if alone := [depths.get(number) or grays[number] for number in depths.keys() ^ grays.keys()]:
            warnings.warn(
                f"{len(alone)} of {len(depths) + len(grays)} images are left out, since no image of the other kind has "
                f"their number: the first is {min(alone)}",
                stacklevel=3,
            )
        rate_hz = self._positive("fps", RATE_HZ)
        both = [number for number in depths if number in grays]
        return [Pair(stamp_s=number * (1 / rate_hz), gray=grays[number], depth=depths[number]) for number in both]

    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        """Return the camera of `intrinsic_matrix`, `width` and `height` in the metadata."""
        path, metadata = self._metadata_path, self._metadata
        if not metadata:
            reason = f"expected the camera in {CALIBRATION} or {' or '.join(METADATA)} in {folder}, got none"
            raise no_camera(reason, folder, image_shape(first.depth))
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

    def _positive(self, key: str, default: float = 0.0) -> float:
        value = self._metadata.get(key, default)
        if type(value) not in (int, float) or not 0 < value <= LARGEST:
            raise DatasetError(f"expected a positive number for {key} in {self._metadata_path}, got {str(value)[:80]}")
        return float(value)


def _named(folder: Path, names: Sequence[str]) -> Path | None:
    """Return the first folder in a folder that has one of some names, in upper or lower case; None without one."""
    return next(iter(_all_named(folder, names)), None)


def _all_named(folder: Path, names: Sequence[str]) -> list[Path]:
    """Return the folders in a folder that have one of some names, in the order of the names."""
    found = {path.name.lower(): path for path in list_folder(folder) if path.is_dir()}
    return [found[name] for name in names if name in found]


def _depth_files(folder: Path) -> list[Path]:
    """Return the images of depth: in the first format with more than 8 bits, or else in the first that is there."""
    formats = [files for suffix in DEPTH_SUFFIXES if (files := list_images(folder, (suffix,)))]
    found = next((files for files in formats if len(formats) > 1 and is_deep(files[0])), formats[0] if formats else [])
    if not found and (others := list_images(folder, GRAY_SUFFIXES)):
        raise DatasetError(
            f"{others[0]} is a JPEG, which holds no depth, as {', '.join(DEPTH_SUFFIXES)} do: if the depth is in the "
            "folder of the images, exchange the names of the two folders, else export it without loss"
        )
    return found


def _read_metadata(folder: Path) -> tuple[Path, Mapping[str, Any]]:
    """Return the description of the camera by Open3D's tools; empty without one."""
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
