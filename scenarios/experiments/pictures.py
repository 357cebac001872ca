"""The last frame of each sequence as the sensor measured it and as methods corrected it, with the truth and sources."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from voxdepth.colors import FAR_M, colored, source_colored
from voxdepth.registry import DEFAULT, PAPER, create_corrector
from voxdepth.types import FloatImage

from ..errors import ScenarioError
from ..evaluation.result_cache import decoded_thumbnail
from ..images import Image, picked, titled
from .comparison import HOLES, Comparison
from .experiment import ExperimentContext

COLUMNS = 3
"""Panels side by side."""
PANEL_PIXELS = 32_400
"""Largest number of pixels of a panel: documents show the pictures."""
SHADES = 40
"""Number of distinct depth colours; fewer make smaller files."""
GAP_PX, WHITE = 4, 245
TICKS_M = range(0, int(FAR_M) + 1, 5)
"""Ticks of the colour scale; the last one includes all farther depths."""
SCALE_PX, LINE_PX = 14, 18
"""Height of the colour scale, and of a line of text."""
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.4
LEGEND = "top right: the baseline with the least error in holes", "source: sensor gray, memory blue, inpainted orange"


def last_frames(context: ExperimentContext, comparison: Comparison) -> dict[str, bytes]:
    """A PNG of each sequence by its name."""
    pictures = {}
    for name, baseline in comparison.best(HOLES)["name"].items():
        methods = (PAPER, *([] if baseline is None else [baseline]), DEFAULT)
        info = comparison.evaluation.sequences[name]
        corrected = {method: comparison.evaluation.result(name, method).thumbnail for method in methods}
        thumbnails = {"as given": info.raw, **corrected, "truth": info.reference}
        depths_m = {title: decoded_thumbnail(thumbnail) for title, thumbnail in thumbnails.items()}
        height, width = depths_m["truth"].shape
        width_px = min(width, int((PANEL_PIXELS * width / height) ** 0.5))
        images = {title: colored(quantized(picked(depth_m, width_px))) for title, depth_m in depths_m.items()}
        images["source"] = picked(_source_image(context, name), width_px)
        lines = (f"{name}, frame {info.frames - 1}; no depth: black", *LEGEND)
        pictures[name] = encoded(sheet(images, lines))
    return pictures


def _source_image(context: ExperimentContext, sequence: str) -> Image:
    """The source of each depth of the default method in the last frame, in colours, shape (H, W, 3)."""
    corrector = create_corrector(DEFAULT, context.recording(sequence).intrinsics)
    for frame in context.frames_of(sequence):
        source = corrector.process(frame).source
    return source_colored(source)


def quantized(depth_m: FloatImage) -> FloatImage:
    """Depth [m] rounded up to distinct colours, shape (H, W); 0 stays 0, and no other depth becomes 0."""
    shade = np.ceil(SHADES * np.sqrt(np.minimum(depth_m, np.float32(FAR_M)) / np.float32(FAR_M)))
    rounded_m: FloatImage = (np.square(shade / SHADES) * FAR_M).astype(np.float32)
    return rounded_m


def sheet(panels: Mapping[str, Image], lines: Sequence[str]) -> Image:
    """Panels of one size in rows, each below its title, above a depth scale and lines of text."""
    padding = ((0, GAP_PX), (0, GAP_PX), (0, 0))
    padded = [np.pad(titled(title, image), padding, constant_values=WHITE) for title, image in panels.items()]
    padded += [np.full_like(padded[0], WHITE)] * (-len(padded) % COLUMNS)
    rows = [np.hstack(padded[start : start + COLUMNS]) for start in range(0, len(padded), COLUMNS)]
    width_px = rows[0].shape[1]
    return np.vstack([*rows, _scale(width_px), *(_line(width_px, {2: line}) for line in lines)])


def encoded(image: Image) -> bytes:
    """The image as PNG with the strongest compression."""
    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise ScenarioError(f"a picture of {image.shape[1]}x{image.shape[0]} pixels cannot be encoded as PNG")
    return data.tobytes()


def _scale(width_px: int) -> Image:
    """The colours from 0 m to the farthest depth, with numbers."""
    depth_m = np.tile(np.linspace(0.01, FAR_M, width_px, dtype=np.float32), (SCALE_PX, 1))
    ticks = {round(tick_m / FAR_M * width_px): f"{tick_m} m" for tick_m in TICKS_M[:-1]}
    ticks[width_px] = f">{TICKS_M[-1]} m"
    return np.vstack([colored(quantized(depth_m)), _line(width_px, ticks)])


def _line(width_px: int, texts: Mapping[int, str]) -> Image:
    """A line of texts by their first columns; a text that does not fit is moved to the left."""
    line = np.full((LINE_PX, width_px, 3), WHITE, np.uint8)
    for start_px, text in texts.items():
        (length_px, _), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        at = (max(0, min(start_px, width_px - length_px - 2)), LINE_PX - 5)
        cv2.putText(line, text, at, FONT, FONT_SCALE, (30, 30, 30), 1, cv2.LINE_AA)
    return line
