"""Panels of the figures of experiments: one line or group of bars for each column of a frame."""

from collections.abc import Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from ..figure import Draw, encoded, panel_figure

MARKERS = "osD^v<>P*X"


def picture(title: str, panels: Sequence[Draw], **style: Any) -> bytes:
    """The panels side by side as PNG; `style` is that of `panel_figure`."""
    return encoded(panel_figure(title, panels, **style))


def plotted(frame: pd.DataFrame, title: str, x: str, y: str, **style: Any) -> Draw:
    """A panel with a line for every column of a frame, or a bar with `kind="bar"`; `style` is that of `plot`."""

    def draw(axes: Axes) -> None:
        looks = {"width": 0.84, "rot": 0} if "bar" in style.get("kind", "") else {"marker": "o", "ms": 4}
        frame.plot(ax=axes, fontsize=7, legend=False, **looks | style)
        labelled(axes, title, x, y)
        if len(frame.columns) > 1:
            axes.legend(fontsize=7)

    return draw


def bars(frame: pd.DataFrame, title: str, y: str, number: str) -> Draw:
    """A panel with a group of bars for every row of a frame, each with its value; the legend is that of the figure."""

    def draw(axes: Axes) -> None:
        frame.plot(ax=axes, kind="bar", rot=0, width=0.84, fontsize=7, legend=False)
        labelled(axes, title, "", y)
        for group in axes.containers:
            axes.bar_label(group, fmt=number, fontsize=6, padding=1)  # type: ignore[arg-type]
        axes.margins(y=0.15)

    return draw


def labelled(axes: Axes, title: str, x: str, y: str) -> None:
    """Set the title, both labels with their units, and a grid behind the marks."""
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)
