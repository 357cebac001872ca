"""Figures: legends leave the panels their size."""

import cv2
import numpy as np

from scenarios.figure import DPI, PANEL_IN, panels


def test_a_picture_grows_for_its_shared_legend() -> None:
    def draw(axes: object) -> None:
        for k in range(19):
            axes.plot([0, 1], [k, k], label=f"a method {k}")  # type: ignore[attr-defined]

    heights_px = [
        cv2.imdecode(np.frombuffer(panels("", [draw], shared_legend=shared), np.uint8), 0).shape[0]
        for shared in (False, True)
    ]
    assert 0.9 * PANEL_IN[1] * DPI < heights_px[0] < heights_px[1] - 50
