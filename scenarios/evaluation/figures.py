"""The figures of the report, as PNG in base64: every axis with its unit, every panel with its sample size."""

import base64
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .cell import COMPLETED, FILLED, FRAMES, Cell, Figure
from .facts import Facts
from .groups import BINS, NEAR
from .methods import ORACLE
from .quantities import BACKGROUND
from .suite import Done
from .tables import count_text
from .trust_score import CONFIDENCES, WITHIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

SHOWN = ("raw", "paper", "voxdepth", "realsense", "lmeds", "flow", "ip-basic", "global-smoother", ORACLE)
"""Methods that lines and points are drawn of, where they took part; other ones if none of these did."""
N_SHOWN = len(SHOWN)
PANEL_COLUMNS = 3
LEGEND_COLUMNS = 8
WIDTH_IN, DPI = 13.0, 100
MARKERS = "os^vD<>phX*dP8"
GRADED = 2
"""A confidence is graded when it fills more bins than this: with two it only says measured or filled in."""
INVISIBLE = "\N{ZERO WIDTH SPACE}"


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A figure of the report."""

    title: str
    caption: str
    png: str
    """Base64."""


def shown_methods(done: Done) -> list[str]:
    """The methods that figures are drawn of."""
    there = list(dict.fromkeys(cell.key.method for cell in done.cells if cell.error is None))
    return [name for name in SHOWN if name in there] or there[:N_SHOWN]


def all_figures(done: Done) -> list[Picture]:
    """The figures about numbers; none if nothing succeeded, and none of confidence if no method grades it."""
    if not shown_methods(done):
        return []
    always = [error_against_range(done), holes_against_quality(done), error_against_latency(done)]
    return [*always, reliability(done)] if graded_methods(done) else always


def error_against_range(done: Done) -> Picture:
    """Mean absolute error by range bin, a panel for each sequence."""
    methods = shown_methods(done)

    def draw(axes: "Axes", facts: Facts) -> None:
        mask = "all" if facts.is_true else facts.hidden
        for k, cell in _cells(done, facts, methods):
            figures = [cell.figure("mae", mask, name, COMPLETED) for name in BINS]
            places = [i for i, figure in enumerate(figures) if figure is not None and figure.value]
            values = [figure.value for figure in figures if figure is not None and figure.value]
            axes.plot(
                places, values, marker=MARKERS[k % len(MARKERS)], color=f"C{k}", label=legible(cell.key.method), ms=4
            )
        counts = [f"{name}\n{count_text(facts.pixels[mask].get(name, 0))}" for name in BINS]
        axes.set_xticks(range(len(BINS)), counts, fontsize=7)
        axes.set_yscale("log")
        depth = "true depth" if facts.is_true else f"depth of {facts.hidden} pixels"
        axes.set_xlabel(f"{depth}, and number of pixels n")
        axes.set_ylabel("MAE [m]")

    return Picture(
        title="Error against range",
        caption="Mean absolute error after completion by the nearest valid: of all pixels by their true depth, or, "
        "without the truth, of held-out pixels by the depth that was measured; n is the number of pixels of a bin over "
        "all frames.",
        png=_panels(done, draw),
    )


def holes_against_quality(done: Done) -> Picture:
    """RQ1: the quality of every frame against how much of it is occluded, all sequences in one panel."""
    from matplotlib.figure import Figure as Canvas

    canvas = Canvas(figsize=(WIDTH_IN, 4.5), dpi=DPI, layout="constrained")
    axes = canvas.subplots()
    known = [facts for facts in done.facts.values() if facts.occluded_shares]
    for k, name in enumerate(shown_methods(done)):
        points = [point for facts in known for point in _occluded_and_psnr(done, facts, name)]
        x, y = np.reshape(points, (-1, 2)).T
        axes.scatter(x, y, s=10, marker=MARKERS[k % len(MARKERS)], color=f"C{k}", label=legible(name))
    for facts in known:
        where = (100 * float(np.mean(facts.occluded_shares)), 0.02)
        label = axes.annotate(facts.name, where, xycoords=("data", "axes fraction"), rotation=90, fontsize=7)
        label.set_parse_math(False)
        label.set_in_layout(False)
    axes.set_xlabel(f"occluded pixels of a frame [%], n = {sum(facts.frames for facts in known)} frames")
    axes.set_ylabel("PSNR, peak 65535 mm [dB]")
    axes.grid(alpha=0.3)
    _add_legend(canvas, *axes.get_legend_handles_labels())
    return Picture(
        title="RQ1: holes against quality",
        caption="One point for each frame and method: how much of the frame the second camera does not see, and the "
        "PSNR of the surfaces within 65.5 m after completion. Sequences without an occlusion mask are left out.",
        png=png_of(canvas),
    )


def error_against_latency(done: Done) -> Picture:
    """What error costs in time, a panel for each sequence, with the front of the methods that nothing beats in both."""
    methods = list(dict.fromkeys(cell.key.method for cell in done.cells))

    def draw(axes: "Axes", facts: Facts) -> None:
        points = _latency_and_error(done, facts)
        for name, (x, y) in points.items():
            k = methods.index(name)
            axes.scatter([x], [y], s=22, marker=MARKERS[k % len(MARKERS)], color=f"C{k % 10}", label=legible(name))
        front = pareto_front([point for name, point in points.items() if name != ORACLE])
        if front:
            axes.plot(*zip(*front, strict=True), color="0.6", lw=1, zorder=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        n = facts.pixels[facts.hidden].get(NEAR, 0)
        axes.set_xlabel(f"time per frame of {facts.size} [ms], n = {facts.frames}")
        axes.set_ylabel(f"MAE in {facts.hidden} [m], n = {count_text(n)} pixels")

    return Picture(
        title="Error against latency",
        caption="Mean absolute error where the sensor has no depth (or where it was held out), surfaces within 20 m, "
        "after completion, against the median time per frame, OpenCV on one thread, plus the mean CPU time of the "
        "method's own threads. The grey line joins the "
        f"methods that no other beats in both; {ORACLE} is an oracle and does not compete.",
        png=_panels(done, draw),
    )


def graded_methods(done: Done) -> list[str]:
    """The methods whose confidence has more to say than two values."""
    graded = [cell for cell in done.cells if len(_by_confidence(cell)) > GRADED]
    return list(dict.fromkeys(cell.key.method for cell in graded))


def reliability(done: Done) -> Picture:
    """What confidence is worth: how many pixels are right by how sure the method is of them, a panel a sequence."""
    methods = graded_methods(done)

    def draw(axes: "Axes", facts: Facts) -> None:
        totals = []
        for k, cell in _cells(done, facts, methods):
            bins = _by_confidence(cell)
            x = [max(0.0, (place - 0.5) / 10) for place in bins]
            counts = np.array([figure.n for figure in bins.values()])
            totals.append(int(counts.sum()))
            right = [100 * figure.value for figure in bins.values() if figure.value is not None]
            color = f"C{k % 10}"
            axes.plot(x, right, marker=MARKERS[k % len(MARKERS)], color=color, label=legible(cell.key.method), ms=4)
            axes.plot(x, 100 * counts / counts.sum(), ":", color=color, lw=1)
        axes.set_xlim(-0.03, 1)
        axes.set_ylim(0, 100)
        axes.set_xlabel(f"confidence, n = {' and '.join(count_text(total) for total in totals) or 0} pixels")
        axes.set_ylabel("pixels that are right [%]")

    return Picture(
        title="Confidence against errors",
        caption=f"Of the pixels that a method gives a depth, {WITHIN}, in bins of its confidence of 0.1 (and 0 alone): "
        "the share that is right, within 5 % or a quarter of a pixel of disparity (lines), and the share of the "
        "method's pixels that are in the bin (dotted). "
        "A line that rises is a confidence to go by. Methods whose pixels are in one or two bins are left out.",
        png=_panels(done, draw),
    )


def _by_confidence(cell: Cell) -> dict[int, Figure]:
    """The share of right pixels in each bin that has some, by the place of the bin."""
    figures = {place: cell.figure("right", mask, WITHIN, FILLED) for place, mask in enumerate(CONFIDENCES)}
    return {place: figure for place, figure in figures.items() if figure is not None}


def _occluded_and_psnr(done: Done, facts: Facts, method: str) -> list[tuple[float, float]]:
    """Share of occluded pixels [%] and PSNR [dB] of each frame of a sequence that has one."""
    psnrs_db = next((cell.frame_psnrs_db for cell in _done_cells(done, facts) if cell.key.method == method), ())
    if len(psnrs_db) != len(facts.occluded_shares):
        return []
    pairs = zip(facts.occluded_shares, psnrs_db, strict=True)
    return [(100 * share, psnr_db) for share, psnr_db in pairs if psnr_db is not None]


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points that no other one is below in one coordinate and not above in the other, by the first coordinate."""
    front: list[tuple[float, float]] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def _latency_and_error(done: Done, facts: Facts) -> dict[str, tuple[float, float]]:
    mask = facts.hidden
    points = {}
    for cell in _done_cells(done, facts):
        latency = cell.figure("latency_p50", FRAMES, FRAMES, FRAMES)
        error = cell.figure("mae", mask, NEAR, COMPLETED)
        if latency and error and latency.value is not None and error.value is not None:
            beside = cell.figure(BACKGROUND, FRAMES, FRAMES, FRAMES)
            beside_ms = beside.value if beside and beside.value is not None else 0.0
            points[cell.key.method] = latency.value + beside_ms, error.value
    return points


def _done_cells(done: Done, facts: Facts) -> list[Cell]:
    return [cell for cell in done.cells if cell.key.sequence == facts.name and cell.error is None]


def _cells(done: Done, facts: Facts, methods: Sequence[str]) -> list[tuple[int, Cell]]:
    """Those of some methods on a sequence, each with the place of its method, by which it has its colour."""
    there = {cell.key.method: cell for cell in _done_cells(done, facts)}
    return [(k, there[name]) for k, name in enumerate(methods) if name in there]


def _panels(done: Done, draw: Callable[["Axes", Facts], None]) -> str:
    """A panel for each sequence, and one legend for all."""
    from matplotlib.figure import Figure as Canvas

    rows = -(-len(done.facts) // PANEL_COLUMNS)
    canvas = Canvas(figsize=(WIDTH_IN, 3.4 * rows + 0.4), dpi=DPI, layout="constrained")
    grid: Any = canvas.subplots(rows, min(PANEL_COLUMNS, len(done.facts)), squeeze=False)
    labels: dict[str, Any] = {}
    for axes, facts in zip(grid.flat, done.facts.values(), strict=False):
        draw(axes, facts)
        axes.set_title(facts.name, fontsize=10, parse_math=False)
        axes.grid(alpha=0.3)
        handles, names = axes.get_legend_handles_labels()
        labels |= dict(zip(names, handles, strict=True))
    for axes in list(grid.flat)[len(done.facts) :]:
        axes.set_visible(False)
    if labels:
        _add_legend(canvas, list(labels.values()), list(labels))
    return png_of(canvas)


def legible(name: str) -> str:
    """A name as a label: matplotlib leaves labels that begin with an underscore out of legends."""
    return f"{INVISIBLE}{name}" if name.startswith("_") else name


def _add_legend(canvas: "Canvas", handles: Sequence[Any], names: Sequence[str]) -> None:
    """Below all panels, with names as they are: a dollar sign in one begins no formula."""
    legend = canvas.legend(handles, names, loc="outside lower center", ncols=LEGEND_COLUMNS, fontsize=8)
    for text in legend.get_texts():
        text.set_parse_math(False)


def png_of(canvas: "Canvas") -> str:
    """A figure as PNG, in base64."""
    data = io.BytesIO()
    canvas.savefig(data, format="png", metadata={"Software": None})
    return base64.b64encode(data.getvalue()).decode()
