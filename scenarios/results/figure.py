"""Figures as PNG: one style, axes with units, sample sizes in the titles."""

import base64
import io
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Self

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from voxdepth.tools.table import Table

DPI = 110
PANEL_IN = (5.2, 3.8)
"""Width and height of a panel."""
MARKERS = "os^vD<>phX*dP8"
"""Marker of the k-th line or point."""
N_COLORS = 20
"""Number of colours of lines that are told apart: ten strong ones, and then ten pale ones."""
LEGEND_COLUMNS = 8
"""Largest number of entries side by side in a shared legend."""
LETTERS_PER_IN = 14
"""Letters of a legend that fit into an inch; a line and the gaps around it take as much as 7."""
LEGEND_ROW_IN, LEGEND_MARGIN_IN = 0.175, 0.25
"""Height of a row of a shared legend, and of what is around it."""
FEW_DECADES, SOME_DECADES = 1.0, 3.0
"""Axes of up to so many decades have ticks at equal distances, or at 1, 2 and 5; longer ones have powers of ten."""
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
    """Return the colour of the k-th line or point, RGB in 0..1; they begin again after `N_COLORS`."""
    from matplotlib import colormaps

    strong, pale = k % 10, k // 10 % 2  # The map has a strong and a pale one by turns.
    red, green, blue, _ = colormaps["tab20"](2 * strong + pale)
    return red, green, blue


def label_axes(axes: "Axes", title: str, x: str, y: str) -> None:
    """Set the title, both axis labels (with their units) and a grid."""
    axes.set_title(title, fontsize=9, parse_math=False)
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    axes.grid(alpha=0.3)


def log_scale(axes: "Axes", name: Literal["x", "y"]) -> None:
    """Make an axis logarithmic once all is drawn; its ticks are plain numbers that do not touch each other."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

    axes.set(**{f"{name}scale": "log"})
    (low, high), axis = getattr(axes, f"get_{name}lim")(), getattr(axes, f"{name}axis")
    decades = math.log10(high / low)
    if decades <= FEW_DECADES:
        axis.set_major_locator(MaxNLocator(5))
    else:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades <= SOME_DECADES else (1,)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def grouped_bars(
    axes: "Axes",
    groups: Sequence[str],
    series: Mapping[str, Sequence[float | None]],
    *,
    colors: Mapping[str, str] | None = None,
    errors: Mapping[str, Any] | None = None,
) -> None:
    """Draw a group of bars per name on the horizontal axis, and a legend of the series.

    Args:
        axes: The panel.
        groups: Names of the groups.
        series: One value per group by the name of the series; None and NaN have no bar.
        colors: Color of a series that does not get the next one of the cycle.
        errors: Distances of the lower and upper ends of error bars, shape (2, n_groups), by the name of a series.
    """
    width, colors, errors = 0.84 / len(series), colors or {}, errors or {}
    for k, (name, values) in enumerate(series.items()):
        places = [place + (k - (len(series) - 1) / 2) * width for place in range(len(groups))]
        known = [float("nan") if value is None else value for value in values]
        style: dict[str, Any] = {"label": legend_label(name), "color": colors.get(name), "yerr": errors.get(name)}
        axes.bar(places, known, width, capsize=3, **style)
    axes.set_xticks(range(len(groups)), groups, fontsize=7)
    axes.legend(fontsize=7)


def marked_lines(axes: "Axes", table: "Table", x: str, y: str, *, by: str = "sequence", text: str = "") -> None:
    """Draw one line per entry of a column of a table, and a legend of these entries.

    Args:
        axes: The panel.
        table: Rows without a number in `x` or `y` are left out.
        x: Name of the column of the horizontal axis.
        y: Name of the column of the vertical axis.
        by: Name of the column whose entries are the lines.
        text: Name of the column with the text beside each point; empty for none.
    """
    lines = table.column(by)
    for k, name in enumerate(dict.fromkeys(lines)):
        columns = [table.column(column) for column in (x, y, text or x)]
        points = [point for line, *point in zip(lines, *columns, strict=True) if line == name and None not in point[:2]]
        xs, ys = ([point[axis] for point in points] for axis in (0, 1))
        axes.plot(xs, ys, marker=MARKERS[k % len(MARKERS)], ms=4, label=name)
        for *at, value in points if text else ():
            words = f"{value:.1f}" if isinstance(value, float) else str(value)
            axes.annotate(words, at, fontsize=6, xytext=(2, 3), textcoords="offset points")  # type: ignore[arg-type]
    axes.legend(fontsize=7)


def add_shared_legend(figure: "Figure") -> None:
    """Put one legend of all panels below them in the place of their own; the figure grows for it.

    A dollar sign in a name begins no formula.
    """
    labels: dict[str, Any] = {}
    for axes in figure.axes:
        handles, names = axes.get_legend_handles_labels()
        labels |= dict(zip(names, handles, strict=True))
        if (own := axes.get_legend()) is not None:
            own.remove()
    if labels:
        fitting = int(LETTERS_PER_IN * figure.get_figwidth() / (max(map(len, labels)) + 7))
        columns = max(1, min(LEGEND_COLUMNS, fitting))
        rows = -(-len(labels) // columns)
        figure.set_figheight(figure.get_figheight() + LEGEND_ROW_IN * rows + LEGEND_MARGIN_IN)
        place: dict[str, Any] = {"loc": "outside lower center", "ncols": columns, "fontsize": 8}
        for text in figure.legend(list(labels.values()), list(labels), **place).get_texts():
            text.set_parse_math(False)


def legend_label(name: str) -> str:
    """Return a name as a legend shows it: matplotlib leaves out labels that begin with an underscore."""
    return f"{INVISIBLE}{name}" if name.startswith("_") else name


def png_of(figure: "Figure") -> bytes:
    """Return a figure as PNG, without anything that changes from call to call."""
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()
