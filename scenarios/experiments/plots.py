"""Panels of the figures of experiments: one line or group of bars for each column of a frame."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from ..figure import Draw, encoded, panel_figure

MARKERS = "osD^v<>P*X"


def picture(title: str, panels: Sequence[Draw], **style: Any) -> bytes:
    """Return the panels side by side as PNG; `style` is that of `panel_figure`."""
    return encoded(panel_figure(title, panels, **style))


def plotted(frame: pd.DataFrame, title: str, x: str, y: str, **style: Any) -> Draw:
    """Return a panel with a line for every column of a frame, or with bars.

    Args:
        frame: A row per value on the axis x, which is its index; a column per line.
        title: Title of the panel.
        x: Label of the axis x, with its unit.
        y: Label of the axis y, with its unit.
        **style: Arguments of `DataFrame.plot`, as in `kind="bar"`.
    """

    def draw(axes: Axes) -> None:
        looks = {"width": 0.84, "rot": 0} if "bar" in style.get("kind", "") else {"marker": "o", "ms": 4}
        frame.plot(ax=axes, fontsize=7, legend=False, **looks | style)
        labelled(axes, title, x, y)
        if len(frame.columns) > 1:
            axes.legend(fontsize=7)

    return draw


def bars(frame: pd.DataFrame, title: str, y: str, number: str) -> Draw:
    """Return a panel with a group of bars for every row of a frame; the legend is that of the figure.

    Args:
        frame: A row per group, a column per bar in it.
        title: Title of the panel.
        y: Label of the axis y, with its unit.
        number: Format of the value above each bar, as in `%.2f`.
    """

    def draw(axes: Axes) -> None:
        frame.plot(ax=axes, kind="bar", rot=0, width=0.84, fontsize=7, legend=False)
        labelled(axes, title, "", y)
        for group in axes.containers:
            axes.bar_label(group, fmt=number, fontsize=6, padding=1)  # type: ignore[arg-type]
        axes.margins(y=0.15)

    return draw


def curves(of: Mapping[Hashable, pd.DataFrame], title: str, x: str, y: str) -> Draw:
    """Return a panel with the columns of each of several frames in its colour: the first as a line, others dotted.

    Args:
        of: A frame by its name in the legend; its rows are the points along its index, the axis x.
        title: Title of the panel.
        x: Label of the axis x, with its unit.
        y: Label of the axis y, with its unit.
    """

    def draw(axes: Axes) -> None:
        for k, (name, frame) in enumerate(of.items()):
            for dotted, column in enumerate(frame):
                looks = {"ls": ":"} if dotted else {"label": name}
                axes.plot(frame.index, frame[column], marker=MARKERS[k], ms=4, color=f"C{k}", **looks)
        labelled(axes, title, x, y)
        axes.legend(fontsize=7)

    return draw


def labelled(axes: Axes, title: str, x: str, y: str) -> None:
    """Set the title, both labels, and a grid behind the marks.

    Args:
        axes: The panel.
        title: Its title, in which `$` means itself.
        x: Label of the axis x, with its unit.
        y: Label of the axis y, with its unit.
    """
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.set(xlabel=x, ylabel=y)
    axes.grid(alpha=0.3)
    axes.set_axisbelow(True)
