"""A picture of the frame in which a figure became worse most: before, now, the truth, and where it changed."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from voxdepth.colors import UNKNOWN_GRAY, colored, far_end_m
from voxdepth.metrics import is_correct
from voxdepth.tools.evaluation.frames import EvaluationFrame
from voxdepth.types import CorrectedDepth, FloatImage, MaskImage

from ..figure import Draw, image_shown, panel_figure
from ..images import hex_color, save_picture
from .clips import Clip
from .figures import FIGURES, Figure, regions_of, scores

PANEL_IN = (3.4, 2.9)
MISSING, GAINED = (255, 0, 255), (0, 200, 0)
"""Colours of pixels without depth, and of those that have one now but had none, RGB: no value has them."""
CHANGE_ENDS_M = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Changes of the error at the ends of the colours that are chosen from."""
REGION = (255, 200, 0)
"""Colour of a region over the gray image, RGB."""

Colors = npt.NDArray[np.uint8]


class FrameComparison(NamedTuple):
    """A frame of a clip with two corrections of it."""

    title: str
    figure: Figure
    frame: EvaluationFrame
    region: MaskImage
    before: CorrectedDepth
    before_title: str
    now: CorrectedDepth
    focal_baseline_px_m: float


def worst_frame(
    clip: Clip, figure: Figure, before: Sequence[CorrectedDepth], before_title: str, now: Sequence[CorrectedDepth]
) -> FrameComparison:
    """Return the frame of a clip in which a figure grew most.

    Args:
        clip: Frames, with their truth.
        figure: Figure that is compared.
        before: Correction of each frame that it is compared with.
        before_title: What titles call that correction, as in `at main`.
        now: Correction of each frame by the corrector that was evaluated.
    """
    column = FIGURES.index(figure)
    old, new = (scores(clip, results).of_frames[:, column] for results in (before, now))
    grown = np.where(np.isnan(new), -np.inf, new - np.nan_to_num(old))
    k = int(grown.argmax())
    focal_baseline_px_m = clip.intrinsics.focal_baseline_px_m
    region = regions_of(clip.frames[k], k)[figure.region]
    return FrameComparison(
        f"{figure.region} of {clip.title}, frame {k}: {figure.metric} {figure.text(float(new[k]))}, "
        f"{before_title} {figure.text(float(old[k]))}",
        figure,
        clip.frames[k],
        region,
        before[k],
        before_title,
        now[k],
        focal_baseline_px_m,
    )


def draw(path: Path, shown: FrameComparison) -> None:
    """Write the picture of a frame; a failure is a `ToolError`."""
    truth_m = shown.frame.reference_m
    far_m = far_end_m([truth_m, shown.frame.frame.depth_m])
    end_m = _change_end_m(shown)
    panels: list[Draw] = [
        _panel(f"depth, {shown.before_title}", depth_colors(shown.before.depth_m, far_m)),
        _panel("depth, now", depth_colors(shown.now.depth_m, far_m)),
        _panel("depth, truth", depth_colors(truth_m, far_m)),
        _panel("change of the error", change_colors(shown.before.depth_m, shown.now.depth_m, truth_m, end_m)),
        _panel(f"confidence, {shown.before_title}", confidence_colors(shown.before)),
        _panel("confidence, now", confidence_colors(shown.now)),
        _panel("right now (white) or wrong (black)", _right_colors(shown)),
        _panel(f"the pixels that count (yellow): {shown.figure.region}", _region_colors(shown)),
        _scale("depth [m]", far_m, lambda values: depth_colors(values, far_m)),
        _scale("confidence", 1.0, lambda values: _gray_colors(values, values > 0)),
        _scale("change of the error [m]", end_m, lambda values: signed_colors(values / end_m), is_signed=True),
    ]
    figure = panel_figure(shown.title, panels, columns=4, panel_in=PANEL_IN)
    meanings = {"no depth; in the change: none any more": MISSING, "a depth where there was none": GAINED}
    meanings["no truth, or no surface within reach"] = (UNKNOWN_GRAY,) * 3
    patches = [Patch(color=hex_color(color), label=meaning) for meaning, color in meanings.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=8)
    save_picture(path, figure)


def depth_colors(depth_m: FloatImage, far_m: float) -> Colors:
    """Return depth [m] in colours, RGB, `MISSING` where there is none."""
    image = colored(depth_m, far_m)[..., ::-1].copy()
    image[depth_m <= 0] = MISSING
    return image


def confidence_colors(result: CorrectedDepth) -> Colors:
    """Return confidence from black, 0, to white, 1, and `MISSING` where there is no depth."""
    return _gray_colors(result.confidence, result.depth_m > 0)


def change_colors(before_m: FloatImage, now_m: FloatImage, truth_m: FloatImage, end_m: float) -> Colors:
    """Return the change of the absolute error in colours, RGB, shape (H, W, 3); see `signed_colors`.

    Pixels without depth now are `MISSING`, and those that had none before are `GAINED`.

    Args:
        before_m: Depth before, shape (H, W); 0 = none.
        now_m: Depth now, shape (H, W); 0 = none.
        truth_m: True depth, shape (H, W); not finite where there is no surface.
        end_m: Change of the error at the ends of the colours; larger ones look the same.
    """
    image = signed_colors(_change_m(before_m, now_m, truth_m) / end_m)
    image[(before_m <= 0) & (now_m > 0)] = GAINED
    image[now_m <= 0] = MISSING
    image[~np.isfinite(truth_m)] = UNKNOWN_GRAY
    return image


def signed_colors(share: npt.NDArray[np.floating]) -> Colors:
    """Return values of -1..1 in colours, RGB: better blue, the same white, worse red."""
    share = np.clip(share, -1, 1)
    removed = np.stack([np.maximum(-share, 0), np.abs(share), np.maximum(share, 0)], axis=-1)
    return np.asarray(np.rint(255 * (1 - removed)), np.uint8)


def _change_m(before_m: FloatImage, now_m: FloatImage, truth_m: FloatImage) -> FloatImage:
    known_m = np.where(np.isfinite(truth_m), truth_m, np.float32(0))
    return np.asarray(np.abs(now_m - known_m) - np.abs(before_m - known_m), np.float32)


def _change_end_m(shown: FrameComparison) -> float:
    both = (shown.before.depth_m > 0) & (shown.now.depth_m > 0) & np.isfinite(shown.frame.reference_m)
    change_m = np.abs(_change_m(shown.before.depth_m, shown.now.depth_m, shown.frame.reference_m))[both & shown.region]
    largest_m = float(np.quantile(change_m, 0.95)) if change_m.size else 0.0
    return next((end_m for end_m in CHANGE_ENDS_M if end_m >= largest_m), CHANGE_ENDS_M[-1])


def _gray_colors(values: FloatImage, known: MaskImage) -> Colors:
    image = np.repeat(np.rint(255 * values).astype(np.uint8)[..., None], 3, axis=-1)
    image[~known] = MISSING
    return image


def _right_colors(shown: FrameComparison) -> Colors:
    depth_m, truth_m = shown.now.depth_m, shown.frame.reference_m
    known = (depth_m > 0) & (truth_m < np.inf)
    right = np.zeros_like(known)
    right[known] = is_correct(depth_m[known], truth_m[known], shown.focal_baseline_px_m)
    image = _gray_colors(right.astype(np.float32), depth_m > 0)
    image[~np.isfinite(truth_m)] = UNKNOWN_GRAY
    return image


def _region_colors(shown: FrameComparison) -> Colors:
    image = np.repeat(shown.frame.frame.gray[..., None], 3, axis=-1)
    image[shown.region] = (image[shown.region] + np.array(REGION, np.uint16)) // 2
    return image


def _panel(title: str, image: Colors) -> Draw:
    framed = np.pad(image, [(1, 1), (1, 1), (0, 0)], constant_values=UNKNOWN_GRAY)  # It may be as white as the page.
    return image_shown(title, framed, interpolation="nearest")


def _scale(title: str, end: float, colors: Callable[[FloatImage], Colors], *, is_signed: bool = False) -> Draw:
    """Return a panel with the colours of the values from 0, or from `-end`, to `end`."""
    start = -end if is_signed else 0.0
    values = np.linspace(start + end / 1000, end, 500, dtype=np.float32)[None]

    def draw(axes: Axes) -> None:
        axes.imshow(colors(values), extent=(start, end, 0, (end - start) / 12))
        axes.set_title(title, fontsize=8)
        axes.set_yticks([])

    return draw
