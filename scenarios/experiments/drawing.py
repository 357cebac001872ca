"""Figures of experiments, all in one manner: PNG, axes with units, sample sizes in the titles."""

import io
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DPI = 110
PANEL_IN = (5.2, 3.8)
"""Width and height of a panel."""
MARKERS = "os^vD<>phX*dP8"

Draw = Callable[["Axes"], None]


def panels(title: str, *draws: Draw) -> bytes:
    """A figure with a panel for each function, side by side, as PNG."""
    from matplotlib.figure import Figure

    width_in, height_in = PANEL_IN
    figure = Figure(figsize=(width_in * len(draws), height_in), dpi=DPI, layout="constrained")
    grid: Any = figure.subplots(1, len(draws), squeeze=False)
    for draw, axes in zip(draws, grid.flat, strict=True):
        draw(axes)
    figure.suptitle(title, fontsize=10)
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()


def labelled(axes: "Axes", title: str, x: str, y: str) -> None:
    """Title, axes with their units, and a grid."""
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)
