"""The last frame of a sequence as methods saw and corrected it, with maps of the error."""

import base64
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage

from ..images import FAR_M, colored
from .facts import Facts
from .figures import DPI, Picture, png_of, shown_methods
from .suite import Done

WIDTH_IN = 10.5
ERROR_M = 2.0
"""End of the scale of error maps."""
EMPTY_M = -2 * ERROR_M
"""Stands for a pixel without depth: below the scale."""


def exhibit(done: Done, facts: Facts) -> Picture:
    """Raw, reference and corrected depth of the last frame, each with its error map."""
    from matplotlib.figure import Figure as Canvas

    depths = {"raw, as given to the methods": facts.raw, **_of_methods(done, facts)}
    reference_m = decoded(facts.reference)
    rows = 1 + -(-(len(depths) - 1) // 2)
    height = WIDTH_IN / 4 * reference_m.shape[0] / reference_m.shape[1] + 0.3
    canvas = Canvas(figsize=(WIDTH_IN, rows * height + 0.6), dpi=DPI, layout="constrained")
    places: Any = iter(canvas.subplots(rows, 4, squeeze=False).flat)
    n = int(np.count_nonzero(reference_m))
    name = "truth" if facts.is_true else "reference"
    _show(next(places), colored(reference_m)[..., ::-1], f"{name}, {FAR_M:g} m and farther blue")
    scale = _bar(next(places), canvas)
    for title, png in depths.items():
        depth_m = decoded(png)
        _show(next(places), colored(depth_m)[..., ::-1], title)
        axes = next(places)
        axes.imshow(error_map(depth_m, reference_m), **scale)
        axes.set_title(f"error of {title}", fontsize=8, parse_math=False)
        axes.set_axis_off()
    for axes in places:
        axes.set_axis_off()
    which = "the truth" if facts.is_true else "what was measured, some of which was held out"
    return Picture(
        title=f"{facts.name}, frame {facts.frames - 1}",
        caption=f"Depth (near red, far blue, none black) and its error [m] against {which}: red is too far, blue too "
        f"near, white right, black without depth, grey without reference; n = {n} pixels of a narrowed image.",
        png=png_of(canvas),
    )


def _of_methods(done: Done, facts: Facts) -> dict[str, str]:
    """Pictures of some methods on a sequence; the raw depth is shown anyway."""
    there = {cell.key.method: cell.picture for cell in done.cells if cell.key.sequence == facts.name and cell.picture}
    return {name: there[name] for name in shown_methods(done) if name in there and name != "raw"}


def decoded(png: str) -> FloatImage:
    """Depth [m], shape (H, W), of a base64 PNG in millimetres."""
    data = np.frombuffer(base64.b64decode(png), np.uint8)
    depth_mm: npt.NDArray[Any] = np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED))
    return depth_mm.astype(np.float32) / np.float32(1000)


def error_map(depth_m: FloatImage, reference_m: FloatImage) -> npt.NDArray[np.float32]:
    """Depth minus reference, cut to the scale [m], shape (H, W); `EMPTY_M` without depth, NaN without a reference."""
    error_m = np.where(depth_m > 0, np.clip(depth_m - reference_m, -ERROR_M, ERROR_M), np.float32(EMPTY_M))
    return np.where(reference_m > 0, error_m, np.float32(np.nan)).astype(np.float32)


def _show(axes: Any, image: npt.NDArray[np.uint8], title: str) -> None:
    axes.imshow(image)
    axes.set_title(title, fontsize=8, parse_math=False)
    axes.set_axis_off()


def _bar(axes: Any, canvas: Any) -> dict[str, Any]:
    """Draw the scale of the error maps; gives what images of that scale are drawn with."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    colors = colormaps["seismic"].with_extremes(under="black", bad="0.7")
    scale = Normalize(-ERROR_M, ERROR_M)
    axes.set_axis_off()
    bar = canvas.colorbar(ScalarMappable(scale, colors), ax=axes, orientation="horizontal", fraction=0.4)
    bar.set_label("error: depth minus reference [m]", fontsize=8)
    return {"cmap": colors, "norm": scale}
