"""Error maps of the report: the depth that each method gave for the last frame, and how far off it is."""

from typing import Any

import numpy as np
import numpy.typing as npt

from ... import registry
from ...colors import colored, far_end_m
from ...types import FloatImage
from ..figure import Picture, image_shown, panels
from .results import SequenceInfo, decoded_thumbnail
from .suite import Evaluation

COLUMNS, WIDTH_IN = 4, 2.6
"""Images side by side, and the width of each."""
ERROR_SHARE = 0.08
"""End of the scale of errors, as a share of that of the depth beside them."""


def error_maps(evaluation: Evaluation) -> list[Picture]:
    """Draw the depth and the errors of the last frame of each sequence that has a reference there."""
    infos = evaluation.sequences.values()
    return [_error_map_of(evaluation, info) for info in infos if decoded_thumbnail(info.reference_thumbnail).any()]


def _error_map_of(evaluation: Evaluation, info: SequenceInfo) -> Picture:
    """Draw raw and corrected depth of the last frame of a sequence, each with its error map, and the reference."""
    reference_m = decoded_thumbnail(info.reference_thumbnail)
    done = [one for one in evaluation.results if one.sequence == info.name and one.thumbnail and one.method != "raw"]
    shown = {"raw, as given to the methods": info.raw_thumbnail}
    shown |= {registry.title(result.method): result.thumbnail for result in done}
    far_m = far_end_m([reference_m, decoded_thumbnail(info.raw_thumbnail)])
    end_m = ERROR_SHARE * far_m
    ramp_m = np.tile(np.linspace(-end_m, end_m, 240, dtype=np.float32), (24, 1))
    images: dict[str, npt.NDArray[Any]] = {
        "reference": colored(reference_m, far_m)[..., ::-1],
        f"error from -{end_m:g} to {end_m:g} m": error_map(2 * end_m + ramp_m, np.full_like(ramp_m, 2 * end_m), end_m),
    }
    for title, png in shown.items():
        depth_m = decoded_thumbnail(png)
        images[title] = colored(depth_m, far_m)[..., ::-1]
        images[f"error of {title}"] = error_map(depth_m, reference_m, end_m)
    height_in = WIDTH_IN * reference_m.shape[0] / reference_m.shape[1] + 0.3
    draws = [image_shown(title, image) for title, image in images.items()]
    return Picture(
        title=f"{info.name}, frame {info.frames - 1}",
        caption=f"Depth is red where near, blue at {far_m:g} m and beyond, and black where missing. Its error is that "
        f"against the reference: red is too far by up to {end_m:g} m and more, blue too near, white correct, black "
        f"without depth, and grey without reference; n = {np.count_nonzero(reference_m)} pixels of a narrowed image.",
        png=panels("", draws, columns=COLUMNS, panel_in=(WIDTH_IN, height_in)),
    )


def error_map(depth_m: FloatImage, reference_m: FloatImage, end_m: float) -> npt.NDArray[np.float64]:
    """Return depth minus reference [m] in colours, RGB, shape (H, W, 3), on a scale from `-end_m` to `end_m`.

    Pixels without depth are black, those without a reference grey.
    """
    from matplotlib import colormaps

    colors = colormaps["bwr"](0.5 + (depth_m - reference_m) / (2 * end_m))[..., :3]
    colors[depth_m == 0] = 0.0
    colors[reference_m == 0] = 0.7
    return np.asarray(colors)
