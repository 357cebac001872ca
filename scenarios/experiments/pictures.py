"""The last frame of each sequence as the sensor gave it, as methods corrected it, as it is, and from what source."""

from collections.abc import Mapping, Sequence

import cv2
import numpy as np

from voxdepth.registry import DEFAULT, PAPER, create_corrector
from voxdepth.types import FloatImage, Source

from ..errors import ScenarioError
from ..evaluation.result_cache import decoded_thumbnail as decoded
from ..images import FAR_M, Image, colored, picked, titled
from .stage import Stage
from .standing import HOLES, Standing

ROW = 3
"""Panels side by side."""
PANEL_PIXELS = 32_400
"""Of a panel at most: pictures are for documents."""
SHADES = 40
"""Depths that are told apart: fewer make smaller files."""
GAP_PX, WHITE = 4, 245
TICKS_M = range(0, int(FAR_M) + 1, 5)
"""Numbers of the colour scale; the last stands for all beyond."""
BAR_PX, LINE_PX = 14, 18
"""Height of the colour scale, and of a line of text."""
FONT, FONT_SCALE = cv2.FONT_HERSHEY_SIMPLEX, 0.4
SOURCE_COLORS_BGR = {
    Source.INVALID: (0, 0, 0),
    Source.SENSOR: (190, 190, 190),
    Source.MEMORY: (200, 120, 30),
    Source.INPAINTED: (40, 160, 240),
}
LEGEND = "top right: the peer with the least error in holes", "source: sensor gray, memory blue, filled orange"


def pictures_of(stage: Stage, standings: Sequence[Standing]) -> dict[str, bytes]:
    """A PNG of each sequence, by its name."""
    return {at.sequence: encoded(_sheet(at, _sources(stage, at.sequence))) for at in standings}


def _sheet(at: Standing, sources: Image) -> Image:
    """All panels of a sequence, by one colour scale, which is below them."""
    peer = at.best(HOLES).name
    methods = (PAPER, *([] if peer is None else [peer]), DEFAULT)
    depths_m = {
        "as given": decoded(at.facts.raw),
        **{name: decoded(at.done.result(at.sequence, name).thumbnail) for name in methods},
        "truth": decoded(at.facts.reference),
    }
    height, width = depths_m["truth"].shape
    width_px = min(width, int((PANEL_PIXELS * width / height) ** 0.5))
    images = {title: colored(in_shades(picked(depth_m, width_px))) for title, depth_m in depths_m.items()}
    lines = (f"{at.sequence}, frame {at.facts.frames - 1}; no depth: black", *LEGEND)
    return sheet({**images, "source": picked(sources, width_px)}, lines)


def _sources(stage: Stage, sequence: str) -> Image:
    """Where the default method has each pixel of the last frame from, in colours, shape (H, W, 3)."""
    corrector = create_corrector(DEFAULT, stage.recording(sequence).intrinsics)
    for frame in stage.frames_of(sequence):
        source = corrector.process(frame).source
    table = np.zeros((len(Source), 3), np.uint8)
    for kind, color in SOURCE_COLORS_BGR.items():
        table[kind] = color
    image: Image = table[source]
    return image


def in_shades(depth_m: FloatImage) -> FloatImage:
    """Depth [m] rounded to what the colours tell apart, shape (H, W); 0 stays 0, and nothing else becomes it."""
    shade = np.ceil(SHADES * np.sqrt(np.minimum(depth_m, np.float32(FAR_M)) / np.float32(FAR_M)))
    rounded_m: FloatImage = (np.square(shade / SHADES) * FAR_M).astype(np.float32)
    return rounded_m


def sheet(panels: dict[str, Image], lines: Sequence[str]) -> Image:
    """Panels of one size in rows, each below its title; then the scale of depth, and lines of text."""
    spaced = [_spaced(titled(title, image)) for title, image in panels.items()]
    spaced += [np.full_like(spaced[0], WHITE)] * (-len(spaced) % ROW)
    rows = [np.hstack(spaced[start : start + ROW]) for start in range(0, len(spaced), ROW)]
    width_px = rows[0].shape[1]
    return np.vstack([*rows, _scale(width_px), *(_line(width_px, {2: line}) for line in lines)])


def encoded(image: Image) -> bytes:
    """As PNG, as small as it gets."""
    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise ScenarioError(f"a picture of {image.shape[1]}x{image.shape[0]} pixels cannot be encoded as PNG")
    return data.tobytes()


def _spaced(image: Image) -> Image:
    spaced: Image = np.pad(image, ((0, GAP_PX), (0, GAP_PX), (0, 0)), constant_values=WHITE)
    return spaced


def _scale(width_px: int) -> Image:
    """The colours from 0 m to the farthest, with numbers."""
    depth_m = np.tile(np.linspace(0.01, FAR_M, width_px, dtype=np.float32), (BAR_PX, 1))
    ticks = {round(tick_m / FAR_M * width_px): f"{tick_m} m" for tick_m in TICKS_M[:-1]}
    ticks[width_px] = f">{TICKS_M[-1]} m"
    return np.vstack([colored(in_shades(depth_m)), _line(width_px, ticks)])


def _line(width_px: int, texts: Mapping[int, str]) -> Image:
    """A line with texts, each by the column where it starts, or where it still fits."""
    line = np.full((LINE_PX, width_px, 3), WHITE, np.uint8)
    for start_px, text in texts.items():
        (length_px, _), _ = cv2.getTextSize(text, FONT, FONT_SCALE, 1)
        at = (max(0, min(start_px, width_px - length_px - 2)), LINE_PX - 5)
        cv2.putText(line, text, at, FONT, FONT_SCALE, (30, 30, 30), 1, cv2.LINE_AA)
    return line
