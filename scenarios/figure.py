"""Figures as PNG: one style, axes with units, sample sizes in the titles."""

import base64
import io
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from voxdepth.tools.environment import configured

with configured("Matplotlib", "the matplotlibrc in the current folder, or the styles in ~/.config/matplotlib/stylelib"):
    import matplotlib.style  # Which reads the styles of the user, when `rcdefaults` imports it at the latest.
    from matplotlib import colormaps
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 110
PANEL_IN = (5.2, 3.8)
"""Width and height of a panel."""
LEGEND_COLUMNS = 4
"""Largest number of entries side by side in a shared legend."""

Draw = Callable[[Axes], None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A PNG with a title and a caption, as pages show it."""

    title: str
    caption: str
    png: bytes

    @property
    def name(self) -> str:
        """The title as the name of a file."""
        return re.sub(r"\W+", "-", self.title.lower())

    @property
    def base64(self) -> str:
        """The PNG as text for an HTML page."""
        return base64.b64encode(self.png).decode()


def new_figure(size_in: tuple[float, float], dpi: int) -> Figure:
    """Begin a figure of a width and height [inch] with a number of pixels per inch; every figure begins here.

    From here on Matplotlib has its own settings: a configuration file of the user, or of the current folder, would
    change pictures, or ask for TeX.
    """
    matplotlib.rcdefaults()
    return Figure(figsize=size_in, dpi=dpi, layout="constrained")


def panel_figure(
    title: str,
    draws: Sequence[Draw],
    *,
    columns: int | None = None,
    panel_in: tuple[float, float] = PANEL_IN,
    shared_legend: bool = False,
) -> Figure:
    """Draw one panel per function and return the figure.

    Args:
        title: Title of the figure; an empty one is left out.
        draws: Draw the panels, row by row.
        columns: Number of panels side by side; None for all of them.
        panel_in: Width and height of a panel [inch].
        shared_legend: Whether all panels share one legend below the figure.
    """
    columns = len(draws) if columns is None else min(columns, len(draws))
    rows = -(-len(draws) // columns)
    figure = new_figure((panel_in[0] * columns, panel_in[1] * rows), DPI)
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
    strong, pale = k % 10, k // 10 % 2  # The map has a strong and a pale one by turns.
    red, green, blue, _ = colormaps["tab20"](2 * strong + pale)
    return red, green, blue


def image_shown(title: str, image: Any, **style: Any) -> Draw:
    """Return a panel with an image without axes; `style` is that of `Axes.imshow`."""

    def draw(axes: Axes) -> None:
        axes.imshow(image, **style)
        axes.set_title(title, fontsize=8, parse_math=False)
        axes.set_axis_off()

    return draw


def add_shared_legend(figure: Figure) -> None:
    """Put one legend of all panels below the figure."""
    labels: dict[str, Any] = {}
    for axes in figure.axes:
        handles, names = axes.get_legend_handles_labels()
        labels |= dict(zip(names, handles, strict=True))
    below: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, 0), "ncols": LEGEND_COLUMNS}
    figure.legend(list(labels.values()), list(labels), fontsize=8, **below)


def encoded(figure: Figure, kind: Literal["png", "jpg"] = "png") -> bytes:
    """Return a figure with all that is around it as an image, without anything that changes from call to call."""
    data = io.BytesIO()
    metadata = {"Software": None} if kind == "png" else None
    figure.savefig(data, format=kind, metadata=metadata, bbox_inches="tight")
    return data.getvalue()
