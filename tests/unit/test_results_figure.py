"""Figures: legends leave the panels their size."""

from matplotlib.backends.backend_agg import FigureCanvasAgg

from voxdepth.tools.figure import PANEL_IN, panel_figure


def test_a_figure_grows_for_its_shared_legend() -> None:
    def draw(axes: object) -> None:
        for k in range(19):
            axes.plot([0, 1], [k, k], label=f"a method with a long name {k}")  # type: ignore[attr-defined]

    figure = panel_figure("", [draw], shared_legend=True)
    FigureCanvasAgg(figure).draw()
    height_in = figure.axes[0].get_tightbbox().height / figure.dpi
    assert height_in > 0.9 * PANEL_IN[1]
