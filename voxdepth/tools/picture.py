"""A picture of one frame: the image, the depth as measured and as corrected, and where that comes from."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from ..colors import SOURCE_COLORS, colored, far_end_m
from ..types import CorrectedDepth, Frame, GrayImage, Source

Image = npt.NDArray[np.uint8]
"""In colours, shape (H, W, 3), BGR."""
WIDTH_PX = 480
"""Width of a panel."""
PAPER, INK = (245, 245, 245), (30, 30, 30)
BEYOND_SHARE = 0.1
"""Share of the depths that may lie beyond the blue end: what is near shall have colours of its own."""
TITLE_PX, GAP_PX = 22, 4
"""Height of a title, and distance of the panels."""
NAMES = {Source.SENSOR: "gray: sensor", Source.MEMORY: "blue: memory", Source.INPAINTED: "orange: inpainted"}
"""What the colours of the sources stand for; black is invalid."""


def panel(title: str, image: npt.NDArray[Any], width_px: int = WIDTH_PX) -> Image:
    """Return an image, gray or in colours, of a width below its title; its pixels are not mixed."""
    height_px = max(1, round(image.shape[0] * width_px / image.shape[1]))
    sized = cv2.resize(image, (width_px, height_px), interpolation=cv2.INTER_NEAREST)
    colours = cv2.cvtColor(sized, cv2.COLOR_GRAY2BGR) if sized.ndim == 2 else sized
    framed = cv2.copyMakeBorder(colours, TITLE_PX, GAP_PX, 0, GAP_PX, cv2.BORDER_CONSTANT, value=PAPER)
    cv2.putText(framed, title, (2, TITLE_PX - 6), cv2.FONT_HERSHEY_SIMPLEX, 0.45, INK, 1, cv2.LINE_AA)
    return np.asarray(framed, np.uint8)


def source_colored(source: GrayImage) -> Image:
    """Return sources in colours, shape (H, W, 3), BGR; see `NAMES`."""
    palette = np.zeros((256, 3), np.uint8)
    for label, color in SOURCE_COLORS.items():
        palette[label] = color[::-1]
    return np.asarray(palette[source], np.uint8)


def before_and_after(frame: Frame, corrected: CorrectedDepth) -> Image:
    """Draw a frame and its correction in four panels; both depths have the same colours, and holes are black."""
    far_m = far_end_m([frame.depth_m, corrected.depth_m], BEYOND_SHARE)
    above = panel("image", frame.gray), panel("depth as measured; black is a hole", colored(frame.depth_m, far_m))
    below = (
        panel(f"depth as corrected; red is near, blue is {far_m:g} m and farther", colored(corrected.depth_m, far_m)),
        panel(f"source: {', '.join(NAMES.values())}", source_colored(corrected.source)),
    )
    return np.vstack([np.hstack(above), np.hstack(below)])
