"""The last frame of each sequence as the sensor gave it, as methods corrected it, as it is, and from what source."""

from collections.abc import Sequence

import cv2
import numpy as np

from voxdepth.registry import DEFAULT, PAPER, create_corrector
from voxdepth.types import FloatImage, Source

from ..errors import ScenarioError
from ..evaluation.exhibits import decoded
from ..images import FAR_M, Image, colored, picked, titled
from .stage import Stage, cell_of
from .standing import HOLES, Standing

ROW = 3
"""Panels side by side."""
PANEL_PIXELS = 32_400
"""Of a panel at most: pictures are for documents."""
SHADES = 40
"""Depths that are told apart: fewer make smaller files."""
GAP_PX, WHITE = 4, 245
TICKS_M = range(0, int(FAR_M) + 1, 5)
SCALE_PX = (14, 18)
"""Height of the colour scale, and of the numbers below it."""
SOURCE_COLORS_BGR = {
    Source.INVALID: (0, 0, 0),
    Source.SENSOR: (190, 190, 190),
    Source.TEMPLATE: (200, 120, 30),
    Source.INPAINTED: (40, 160, 240),
}
SOURCES = "source: sensor gray, memory blue, filled orange"


def pictures_of(stage: Stage, standings: Sequence[Standing]) -> dict[str, bytes]:
    """A PNG of each sequence, by its name."""
    return {at.sequence: encoded(_sheet(at, _sources(stage, at.sequence))) for at in standings}


def _sheet(at: Standing, sources: Image) -> Image:
    """All panels of a sequence, by one colour scale, which is below them."""
    peer = at.best(HOLES).name
    methods = {PAPER: PAPER, **({} if peer is None else {f"{peer}, best peer": peer}), DEFAULT: DEFAULT}
    depths_m = {
        f"{at.sequence}, frame {at.facts.frames - 1}, raw": decoded(at.facts.raw),
        **{title: decoded(cell_of(at.done, at.sequence, name).picture) for title, name in methods.items()},
        "truth": decoded(at.facts.reference),
    }
    height, width = decoded(at.facts.raw).shape
    width_px = min(width, int((PANEL_PIXELS * width / height) ** 0.5))
    images = {title: colored(in_shades(picked(depth_m, width_px))) for title, depth_m in depths_m.items()}
    return sheet({**images, SOURCES: picked(sources, width_px)})


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


def sheet(panels: dict[str, Image]) -> Image:
    """Panels of one size in rows, each below its title, over the scale of depth."""
    spaced = [_spaced(titled(title, image)) for title, image in panels.items()]
    spaced += [np.full_like(spaced[0], WHITE)] * (-len(spaced) % ROW)
    rows = [np.hstack(spaced[start : start + ROW]) for start in range(0, len(spaced), ROW)]
    return np.vstack([*rows, _scale(rows[0].shape[1])])


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
    bar_px, text_px = SCALE_PX
    depth_m = np.tile(np.linspace(0.01, FAR_M, width_px, dtype=np.float32), (bar_px, 1))
    texts = np.full((text_px, width_px, 3), WHITE, np.uint8)
    for tick_m in TICKS_M:
        text = f"{tick_m} m" if tick_m < FAR_M else f">{tick_m} m"
        (length_px, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)
        left_px = min(int(tick_m / FAR_M * width_px), width_px - length_px - 2)
        cv2.putText(texts, text, (left_px, 13), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (30, 30, 30), 1, cv2.LINE_AA)
    return np.vstack([colored(in_shades(depth_m)), texts])
