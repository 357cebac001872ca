"""Figures as PNG: one style, axes with units, sample sizes in the titles."""

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 110
PANEL_IN = (5.2, 3.8)
"""Width and height of a panel."""
LEGEND_COLUMNS = 4
"""Largest number of entries side by side in a shared legend."""
INVISIBLE = "\N{ZERO WIDTH SPACE}"

Draw = Callable[["Axes"], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A PNG with a title and a caption, as pages show it."""

    title: str
    caption: str
    png: bytes

    @classmethod
    def of(cls, title: str, caption: str, figure: "Figure") -> Self:
        """Save a figure as PNG."""
        return cls(title=title, caption=caption, png=png_of(figure))

    @property
    def base64(self) -> str:
        """The PNG as text for an HTML page."""
        return base64.b64encode(self.png).decode()


def panels(title: str, draws: Sequence[Draw], **style: Any) -> bytes:
    """Draw one panel per function and return the figure as PNG; `style` is that of `panel_figure`."""
    return png_of(panel_figure(title, draws, **style))


def panel_figure(
    title: str,
    draws: Sequence[Draw],
    *,
    columns: int | None = None,
    panel_in: tuple[float, float] = PANEL_IN,
    shared_legend: bool = False,
) -> "Figure":
    """Draw one panel per function and return the figure.

    There are `columns` panels side by side, or all of them if it is None, each with the width and height `panel_in`
    [inch]. An empty title is left out. With `shared_legend` all panels share one legend below the figure.
    """
    from matplotlib.figure import Figure

    columns = len(draws) if columns is None else min(columns, len(draws))
    rows = -(-len(draws) // columns)
    figure = Figure(figsize=(panel_in[0] * columns, panel_in[1] * rows), dpi=DPI, layout="constrained")
    grid: Any = figure.subplots(rows, columns, squeeze=False)
    for draw, axes in zip(draws, grid.flat, strict=False):
        draw(axes)
    for axes in list(grid.flat)[len(draws) :]:
        axes.set_visible(False)
    if title:
        figure.suptitle(title, fontsize=10)
    if shared_legend:
        add_shared_legend(figure)
    return figure


def line_color(k: int) -> tuple[float, float, float]:
    """Return the colour of the k-th line, RGB in 0..1: ten strong ones, then ten pale ones, and then these again."""
    from matplotlib import colormaps

    strong, pale = k % 10, k // 10 % 2  # The map has a strong and a pale one by turns.
    red, green, blue, _ = colormaps["tab20"](2 * strong + pale)
    return red, green, blue


def plotted(frame: "pd.DataFrame", title: str, x: str, y: str, **style: Any) -> Draw:
    """Return a panel with a line, or with `kind="bar"` a bar of each group, for every column of a frame.

    The groups, or the horizontal axis, are the index of the frame; `style` is that of `DataFrame.plot`.
    """

    def draw(axes: "Axes") -> None:
        looks = {"marker": "o", "ms": 4} if style.get("kind", "line") == "line" else {"width": 0.84}
        frame.rename(columns=lambda name: legend_label(str(name))).plot(
            ax=axes, fontsize=7, legend=False, **looks | style
        )
        axes.set_title(title, fontsize=9, parse_math=False)
        axes.set(xlabel=x, ylabel=y)
        axes.grid(alpha=0.3)
        if len(frame.columns) > 1:
            axes.legend(fontsize=7)

    return draw


def image_shown(title: str, image: Any, **style: Any) -> Draw:
    """Return a panel with an image without axes; `style` is that of `Axes.imshow`."""

    def draw(axes: "Axes") -> None:
        axes.imshow(image, **style)
        axes.set_title(title, fontsize=8, parse_math=False)
        axes.set_axis_off()

    return draw


def add_shared_legend(figure: "Figure") -> None:
    """Put one legend of all panels below the figure in the place of their own; no dollar sign begins a formula."""
    labels: dict[str, Any] = {}
    for axes in figure.axes:
        handles, names = axes.get_legend_handles_labels()
        labels |= dict(zip(names, handles, strict=True))
        if (own := axes.get_legend()) is not None:
            own.remove()
    if labels:
        below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0), "ncols": LEGEND_COLUMNS}
        for text in figure.legend(list(labels.values()), list(labels), fontsize=8, **below).get_texts():
            text.set_parse_math(False)


def legend_label(name: str) -> str:
    """Return a name as a legend shows it: matplotlib leaves out labels that begin with an underscore."""
    return f"{INVISIBLE}{name}" if name.startswith("_") else name


def png_of(figure: "Figure") -> bytes:
    """Return a figure with all that is around it as PNG, without anything that changes from call to call."""
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None}, bbox_inches="tight")
    return data.getvalue()
