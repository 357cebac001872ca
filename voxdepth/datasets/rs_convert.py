"""Files of `rs-convert`, the converter of RealSense recordings: one per frame, with the time in its name.

`rs-convert -r P -p P` writes `P_Depth_MS.raw` (16-bit depth), `P_Infrared 1_MS.png` (gray) and more, where MS is the
time of capture in milliseconds. Of these, depth and the left infrared image show one view in one size: infrared is
`Infrared 1`, or `Infrared` where the camera numbers none. Colour has another view, and the converter aligns nothing;
its PNG of depth is a picture in false colours. Neither can be used. Names and contents are those of tools/convert in
IntelRealSense/librealsense.
"""

import re
from collections.abc import Sequence
from pathlib import Path

from ..errors import DatasetError
from .files import list_folder
from .pairs import Pair
from .stamps import associate, require_increasing

WITHIN_S = 0.02
_NAME = re.compile(r".*_(Depth|Infrared|Infrared 1|Color)_([0-9]+(?:\.[0-9]+)?)\.(raw|png)", re.DOTALL)
_DEPTH, _INFRARED = [("Depth", "raw")], [("Infrared", "png"), ("Infrared 1", "png")]

_Stream = list[tuple[float, Path]]
"""Times [s] and files, in order."""


def is_converted(folder: Path) -> bool:
    """Whether there is a file in the folder that the converter could have written."""
    return any(_NAME.fullmatch(path.name) for path in list_folder(folder))


def converted_pairs(folder: Path) -> list[Pair]:
    """Depth and infrared images of nearest time.

    Raises:
        DatasetError: There is no depth, no infrared, or none of one time.
    """
    depth, infrared = _stream(folder, _DEPTH), _stream(folder, _INFRARED)
    if not depth:
        raise DatasetError(f"expected *_Depth_*.raw in {folder}, got none; run rs-convert with -r: its PNG is no depth")
    if not infrared:
        raise DatasetError(
            f"expected *_Infrared*_*.png in {folder}, got none; run rs-convert with -p. Colour is not aligned with the "
            "depth: to use it, align when exporting, and store the images in folders depth and color"
        )
    matches = associate([s for s, _ in depth], [s for s, _ in infrared], within_s=WITHIN_S)
    if not matches:
        raise DatasetError(f"expected depth and infrared within {WITHIN_S} s in {folder}; are they of one recording?")
    return [Pair(stamp_s=depth[i][0], gray=infrared[j][1], depth=depth[i][1]) for i, j in matches]


def _stream(folder: Path, kinds: Sequence[tuple[str, str]]) -> _Stream:
    matches = ((path, _NAME.fullmatch(path.name)) for path in list_folder(folder))
    stream = sorted((float(m[2]) / 1000, path) for path, m in matches if m and (m[1], m[3]) in kinds)
    require_increasing([stamp_s for stamp_s, _ in stream], f"the file names of {kinds[0][0]} in {folder}")
    return stream
