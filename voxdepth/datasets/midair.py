"""Mid-Air: a rendered drone flight, 1024x1024 pixels 25 times a second, depth as 16-bit PNG whose bits are float16.

A folder as its archives unpack, with exactly one trajectory: `color_left/trajectory_NNNN/NNNNNN.JPEG`, and
`stereo_disparity/trajectory_NNNN/NNNNNN.PNG` or else `depth/...`. Disparity is preferred, with
`stereo_occlusion/trajectory_NNNN/NNNNNN.PNG` where there is one: its pixels that are not 0 were not seen by the right
camera and become holes. Both kinds of depth are rendered and thus exact; `depth` beside the disparity is the truth.

Facts and where they are from: frame rate and files, midair.ulg.ac.be (Data organization, Technical specifications);
90 degrees of view with f = cx = cy = w/2, its FAQ; float16 bits and a display range of 1250 m, the example script of
the dataset's repository montefiore-institute/midair-dataset; `depth` is the distance along the ray, the dataset's
author in issue 6 of michael-fonder/M4Depth; z = 512 / disparity, thus a baseline of 1 m, the data loader there. That
occlusion masks are not 0 where a surface is hidden is concluded from their name alone.
"""

import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import DatasetError
from ..types import FloatImage, Intrinsics
from ..units import Unit
from .files import list_folder, list_images
from .images import image_shape, read_depth_16, read_mask
from .pairs import Pair, PairedImages

COLOUR, DISPARITY, RANGE, OCCLUSION = "color_left", "stereo_disparity", "depth", "stereo_occlusion"
RATE_HZ = 25.0
BASELINE_M = 1.0
FARTHEST_M = 1250.0
"""The sky is stored as the largest float16, 65504 m. Farther than this, a disparity is below half a pixel: a hole."""
METRES = Unit(1.0)
_TRAJECTORY = re.compile(r"trajectory_\d+")


class MidAirDataset(PairedImages):
    """One trajectory of Mid-Air, seen by the left camera."""

    format = "midair"
    unit = METRES

    def __init__(self, folder: Path, intrinsics: Intrinsics | None = None, **options: Any) -> None:
        super().__init__(folder, intrinsics, **options)
        if self.unit is not METRES:
            raise DatasetError(f"{folder} is of Mid-Air, whose depth has a unit of its own: leave out units_per_m")

    @classmethod
    def missing(cls, folder: Path) -> str:
        """See `PairedImages`."""
        if not (folder / COLOUR).is_dir() or not _trajectories(folder):
            return f"a folder trajectory_NNNN in {COLOUR}"
        if not any((folder / name).is_dir() for name in (DISPARITY, RANGE)):
            return f"a folder {DISPARITY} or {RANGE} beside {COLOUR}"
        return ""

    def _find_pairs(self, folder: Path) -> list[Pair]:
        if len(trajectories := _trajectories(folder)) != 1:
            raise DatasetError(
                f"expected exactly one trajectory in {folder / COLOUR}, got {', '.join(trajectories)}; "
                "put the images of the one to read into a folder of its own"
            )
        (trajectory,) = trajectories
        colour = _by_number(folder / COLOUR / trajectory, (".jpeg", ".jpg"))
        depth_folders = [folder / name / trajectory for name in (DISPARITY, RANGE)]
        depth_folder = next((path for path in depth_folders if path.is_dir()), depth_folders[-1])
        depth = _by_number(depth_folder, (".png",))
        common = sorted(colour.keys() & depth.keys())
        if not common:
            raise DatasetError(
                f"expected images of the same numbers in {folder / COLOUR / trajectory} (JPEG) and {depth_folder} "
                f"(PNG), got none among {len(colour)} and {len(depth)}; unpack colour and depth of one trajectory"
            )
        if n_alone := len(depth) - len(common):
            alone = f"{n_alone} of {len(depth)} depth images have no gray image of their number and are left out"
            warnings.warn(alone, stacklevel=3)
        return [Pair(stamp_s=number / RATE_HZ, gray=colour[number], depth=depth[number]) for number in common]

    def _known_intrinsics(self, folder: Path, first: Pair) -> Intrinsics:
        height_px, width_px = image_shape(first.gray)
        if height_px != width_px:
            raise DatasetError(f"expected a square image in {first.gray}, as Mid-Air has, got {width_px}x{height_px}")
        f, size = width_px / 2, {"width_px": width_px, "height_px": height_px}
        return Intrinsics(fx_px=f, fy_px=f, cx_px=f, cy_px=f, baseline_m=BASELINE_M, **size)

    def _depth_m(self, pair: Pair) -> FloatImage:
        if pair.depth.parent.parent.name == RANGE:
            return read_range(pair.depth, self.intrinsics)
        depth_m = _read_disparity(pair.depth, self.intrinsics)
        occlusion = pair.depth.parents[2] / OCCLUSION / pair.depth.parent.name / pair.depth.name
        if occlusion.exists():
            depth_m[read_mask(occlusion, self.intrinsics.shape)] = 0
        return depth_m


def true_depths(folder: Path) -> list[Path]:
    """Return the files of the exact depth of all frames, where that is not what is read as measured."""
    if MidAirDataset.missing(folder) or not all((folder / name).is_dir() for name in (DISPARITY, RANGE)):
        return []
    return [path for name in _trajectories(folder) for path in _by_number(folder / RANGE / name, (".png",)).values()]


def read_range(path: Path, intrinsics: Intrinsics) -> FloatImage:
    """Return the depth along the axis of an image of distances along the ray, (H, W) [m]; 0 beyond `FARTHEST_M`."""
    range_m = _read_halves(path, intrinsics)
    x = (np.arange(intrinsics.width_px) - intrinsics.cx_px) / intrinsics.fx_px
    y = (np.arange(intrinsics.height_px) - intrinsics.cy_px) / intrinsics.fy_px
    depth_m: FloatImage = (range_m / np.sqrt(x[None, :] ** 2 + y[:, None] ** 2 + 1)).astype(np.float32)
    return np.where(depth_m <= np.float32(FARTHEST_M), depth_m, np.float32(0))


def _read_disparity(path: Path, intrinsics: Intrinsics) -> FloatImage:
    """Return `z = f B / d`, shape (H, W) [m]; 0 beyond `FARTHEST_M`."""
    disparity_px = _read_halves(path, intrinsics)
    scale = np.float32(intrinsics.fx_px * (intrinsics.baseline_m or BASELINE_M))
    depth_m = np.zeros_like(disparity_px)
    np.divide(scale, disparity_px, out=depth_m, where=disparity_px >= scale / np.float32(FARTHEST_M))
    return depth_m


def _read_halves(path: Path, intrinsics: Intrinsics) -> FloatImage:
    """Return the floats of 16 bits whose bits a PNG has, shape (H, W); NaN and negative ones are errors."""
    values: FloatImage = read_depth_16(path, intrinsics.shape).view(np.float16).astype(np.float32)
    if not (values >= 0).all():
        raise DatasetError(f"expected floats of 16 bits of at least 0 in {path}, got {values.min():g}; restore it")
    return values


def _trajectories(folder: Path) -> list[str]:
    return [path.name for path in list_folder(folder / COLOUR) if _TRAJECTORY.fullmatch(path.name) and path.is_dir()]


def _by_number(folder: Path, suffixes: tuple[str, ...]) -> dict[int, Path]:
    return {int(path.stem): path for path in list_images(folder, suffixes) if re.fullmatch("[0-9]{1,9}", path.stem)}
