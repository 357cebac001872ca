"""Figures: ticks that can be read, and legends that leave the panels their size."""

from itertools import pairwise

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from voxdepth.tools.figure import PANEL_IN, log_scale, panel_figure


@pytest.mark.parametrize("high", [1.1, 4.0, 999.0, 3e8])
def test_numbers_of_a_logarithmic_axis_are_plain_and_do_not_touch(high: float) -> None:
    figure = Figure(figsize=(3.6, 3.0), layout="constrained")
    axes = figure.subplots()
    axes.plot([0.7, 0.7 * high], [1, 2])
    log_scale(axes, "x")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    low, end = axes.get_xlim()
    labels = [label for label in axes.get_xticklabels(which="both") if label.get_text()]
    shown = [label for label in labels if low <= label.get_position()[0] <= end]
    assert len(shown) >= 2
    assert all(float(label.get_text()) > 0 for label in shown), "no powers"
    boxes = sorted((label.get_window_extent(canvas.get_renderer()) for label in shown), key=lambda box: box.x0)
    assert all(left.x1 < right.x0 for left, right in pairwise(boxes))


def test_a_figure_grows_for_its_shared_legend() -> None:
    def draw(axes: object) -> None:
        for k in range(19):
            axes.plot([0, 1], [k, k], label=f"a method with a long name {k}")  # type: ignore[attr-defined]

    figure = panel_figure("", [draw], shared_legend=True)
    FigureCanvasAgg(figure).draw()
    height_in = figure.axes[0].get_tightbbox().height / figure.dpi
    assert height_in > 0.9 * PANEL_IN[1]
