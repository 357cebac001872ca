"""Figures: legends leave the panels their size."""

import cv2
import numpy as np

from scenarios.figure import DPI, PANEL_IN, encoded, panel_figure


def test_a_picture_grows_for_its_shared_legend() -> None:
    def draw(axes: object) -> None:
        for k in range(19):
            axes.plot([0, 1], [k, k], label=f"a method {k}")  # type: ignore[attr-defined]

    pngs = [encoded(panel_figure("", [draw], shared_legend=shared)) for shared in (False, True)]
    heights_px = [cv2.imdecode(np.frombuffer(png, np.uint8), 0).shape[0] for png in pngs]
    assert 0.9 * PANEL_IN[1] * DPI < heights_px[0] < heights_px[1] - 50
