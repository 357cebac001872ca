"""The last frame of each sequence as the sensor measured it and as methods corrected it, with the truth and sources."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from voxdepth.colors import FAR_M, colored, source_colored
from voxdepth.registry import DEFAULT, PAPER, create_corrector
from voxdepth.types import FloatImage

from ..errors import ScenarioError
from ..evaluation.result_cache import decoded_thumbnail
from ..images import WHITE, Image, depth_scale, picked, text_line, titled
from .comparison import HOLES, Comparison
from .experiment import ExperimentContext

COLUMNS = 3
"""Panels side by side."""
PANEL_PIXELS = 32_400
"""Largest number of pixels of a panel: documents show the pictures."""
SHADES = 40
"""Number of distinct depth colours; fewer make smaller files."""
GAP_PX = 4
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
    scale = depth_scale(width_px, lambda depth_m: colored(quantized(depth_m)))
    return np.vstack([*rows, scale, *(text_line(width_px, {2: line}) for line in lines)])


def encoded(image: Image) -> bytes:
    """The image as PNG with the strongest compression."""
    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise ScenarioError(f"a picture of {image.shape[1]}x{image.shape[0]} pixels cannot be encoded as PNG")
    return data.tobytes()
