"""Figures: legends leave the panels their size."""

from typing import Any

import cv2
import matplotlib
import numpy as np
import pytest

from scenarios.figure import DPI, PANEL_IN, encoded, panel_figure


def test_a_picture_grows_for_its_shared_legend() -> None:
    def draw(axes: object) -> None:
        for k in range(19):
            axes.plot([0, 1], [k, k], label=f"a method {k}")

    pngs = [encoded(panel_figure("", [draw], shared_legend=shared)) for shared in (False, True)]
    heights_px = [cv2.imdecode(np.frombuffer(png, np.uint8), 0).shape[0] for png in pngs]
    assert 0.9 * PANEL_IN[1] * DPI < heights_px[0] < heights_px[1] - 50


@pytest.mark.parametrize(
    "style",
    [
        {"text.usetex": True},
        {"axes.formatter.use_locale": True, "axes.facecolor": "black"},
        {"savefig.transparent": True, "savefig.dpi": 30},
        {"font.size": 30, "lines.linewidth": 9},
    ],
)
def test_a_style_of_the_user_changes_no_figure(style: dict[str, Any]) -> None:
    def picture() -> bytes:
        return encoded(panel_figure("title", [lambda axes: axes.plot([0, 1], [0, 1.5])]))

    with matplotlib.rc_context():
        plain = picture()
        matplotlib.rcParams.update(style)
        assert picture() == plain
