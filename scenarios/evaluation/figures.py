"""The figures of the report: every axis has its unit, every panel its sample size."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from voxdepth.colors import FAR_M, colored
from voxdepth.types import FloatImage

from ..results.figure import MARKERS, Draw, Picture, label_axes, legend_label, panels
from .groups import BINS, NEAR
from .measurements import FILLED, Selector, of_frames
from .methods import ORACLE
from .result_cache import SequenceInfo, decoded_thumbnail
from .scoring import CALIBRATION_RANGE, CONFIDENCES
from .suite import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = ("raw", "paper", "voxdepth", "realsense", "lmeds", "flow", "ip-basic", "global-smoother", ORACLE)
"""Methods that lines and points are drawn of; if none of them took part, the first ones that did."""
PANEL_COLUMNS, PANEL_IN = 3, (4.3, 3.5)
WIDE_PANEL_IN = (13.0, 4.5)
ERROR_MAP_COLUMNS, ERROR_MAP_WIDTH_IN = 4, 2.6
ERROR_M = 2.0
"""End of the scale of error maps."""
EMPTY_M = -2 * ERROR_M
"""Value of a pixel without depth in an error map, which is below the scale."""


def all_figures(evaluation: Evaluation) -> list[Picture]:
    """Draw the figures about numbers: none if nothing succeeded, and none of confidence if no method grades it."""
    draws = (error_against_range, holes_against_quality, error_against_latency)
    pictures = [draw(evaluation) for draw in draws if shown_methods(evaluation)]
    return [*pictures, reliability(evaluation)] if graded_methods(evaluation) else pictures


def shown_methods(evaluation: Evaluation) -> list[str]:
    """Return the methods that figures are drawn of."""
    present = list(dict.fromkeys(result.key.method for result in evaluation.results if result.error is None))
    return [name for name in SHOWN if name in present] or present[: len(SHOWN)]


def error_against_range(evaluation: Evaluation) -> Picture:
    """Draw the mean absolute error by range, one panel per sequence."""

    def draw(info: SequenceInfo, axes: "Axes") -> None:
        mask = info.independent
        bins = [_of_sequence(evaluation, info, Selector("mae", mask, name))["value"] for name in BINS]
        values = pd.concat(bins, axis=1, keys=range(len(BINS)))
        values = values[values > 0]
        for k, name in enumerate(shown_methods(evaluation)):
            if name in values.index:
                line = values.loc[name].dropna()
                axes.plot(line.index, line, color=f"C{k}", ms=4, **_labelled(k, name))
        counts = [f"{name}\n{count_text(info.pixels[mask].get(name, 0))}" for name in BINS]
        axes.set_xticks(range(len(BINS)), counts, fontsize=7)
        axes.set_yscale("log")
        depth = f"depth by {info.reference_name}" if mask == "all" else f"depth of held-out {mask}"
        label_axes(axes, info.name, f"{depth}, and number of pixels n", "MAE [m]")

    return _panels(
        evaluation,
        draw,
        "Error against range",
        "The mean absolute error after completion by the nearest valid pixel is that of all pixels by their "
        "true depth or, without the truth, that of held-out pixels by their measured depth; n is the number of pixels "
        "of a bin over all frames.",
    )


def holes_against_quality(evaluation: Evaluation) -> Picture:
    """Draw the quality of every frame against its share of occluded pixels, with all sequences in one panel (RQ1)."""
    known = [info for info in evaluation.sequences.values() if info.occluded_shares]

    def draw(axes: "Axes") -> None:
        for k, name in enumerate(shown_methods(evaluation)):
            ratios_db = [evaluation.result(info.name, name).frame_psnrs_db for info in known]  # Empty if it failed.
            shares = [info.occluded_shares for info in known]
            pairs = chain.from_iterable(map(zip, shares, ratios_db))
            x, y = np.reshape([(100 * share, db) for share, db in pairs if db is not None], (-1, 2)).T
            axes.scatter(x, y, s=10, color=f"C{k}", **_labelled(k, name))
        for info in known:
            where = (100 * float(np.mean(info.occluded_shares)), 0.02)
            label = axes.annotate(info.name, where, xycoords=("data", "axes fraction"), rotation=90, fontsize=7)
            label.set_parse_math(False)
            label.set_in_layout(False)
        frames = sum(info.frames for info in known)
        label_axes(axes, "", f"occluded pixels of a frame [%], n = {frames} frames", "PSNR, peak 65535 mm [dB]")

    return Picture(
        title="RQ1: holes against quality",
        caption="Each point is one frame of one method: the share of the frame that the second camera does not see, "
        "and the PSNR of surfaces within 65.5 m after completion. Sequences without an occlusion mask are left out.",
        png=panels("", [draw], panel_in=WIDE_PANEL_IN, shared_legend=True),
    )


def error_against_latency(evaluation: Evaluation) -> Picture:
    """Draw error against time, one panel per sequence, with the Pareto front."""

    def draw(info: SequenceInfo, axes: "Axes") -> None:
        selectors = of_frames("latency_p50"), of_frames("latency_background"), Selector("mae", info.hidden)
        waiting_ms, background_ms, error_m = (_of_sequence(evaluation, info, one)["value"] for one in selectors)
        points = pd.concat([waiting_ms.add(background_ms, fill_value=0), error_m], axis=1).dropna()
        for k, name in enumerate(evaluation.methods):
            if name in points.index:
                x_ms, y_m = points.loc[name]
                axes.scatter([x_ms], [y_m], s=22, color=f"C{k % 10}", **_labelled(k, name))
        front = pareto_front(list(points.drop(ORACLE, errors="ignore").itertuples(index=False, name=None)))
        if front:
            axes.plot(*zip(*front, strict=True), color="0.6", lw=1, zorder=0)
        axes.set_xscale("log")
        axes.set_yscale("log")
        n = count_text(info.pixels[info.hidden].get(NEAR, 0))
        x, y = f"time per frame of {info.size} [ms], n = {info.frames}", f"MAE in {info.hidden} [m], n = {n} pixels"
        label_axes(axes, info.name, x, y)

    return _panels(
        evaluation,
        draw,
        "Error against latency",
        "The error is the mean absolute error after completion of surfaces within 20 m where the sensor has no "
        "depth, or where its depth was held out. The time is the median time per frame with OpenCV on one thread plus "
        "the mean CPU time of the method's own threads. The grey line is the Pareto front: no method beats these in "
        f"both. {ORACLE} is an oracle and does not compete.",
    )


def reliability(evaluation: Evaluation) -> Picture:
    """Draw the share of correct pixels by confidence, one panel per sequence."""
    methods, right = graded_methods(evaluation), _right_by_confidence(evaluation)

    def draw(info: SequenceInfo, axes: "Axes") -> None:
        totals = []
        for k, name in enumerate(methods):
            bins = right[(right["sequence"] == info.name) & (right["method"] == name)]
            if bins.empty:
                continue
            x, counts = np.maximum(0, (bins["bin"] - 0.5) / 10), bins["n"]
            totals.append(int(counts.sum()))
            axes.plot(x, 100 * bins["value"], color=f"C{k % 10}", ms=4, **_labelled(k, name))
            axes.plot(x, 100 * counts / counts.sum(), ":", color=f"C{k % 10}", lw=1)
        axes.set_xlim(-0.03, 1)
        axes.set_ylim(0, 100)
        n = " and ".join(map(count_text, totals)) or 0
        label_axes(axes, info.name, f"confidence, n = {n} pixels", "pixels that are right [%]")

    return _panels(
        evaluation,
        draw,
        "Confidence against errors",
        f"Pixels that a method gives a depth, {CALIBRATION_RANGE}, are sorted into bins of confidence of width "
        "0.1, and a bin for 0. Lines show the share of a bin that is right, within 5 % or a quarter of a pixel of "
        "disparity; dotted lines show the share of the method's pixels that are in the bin. A rising line means that "
        "the confidence can be trusted. Methods whose pixels are in one or two bins are left out.",
    )


def graded_methods(evaluation: Evaluation) -> list[str]:
    """Return the methods whose confidence fills more than two bins: two only tell measured from filled pixels."""
    bins = _right_by_confidence(evaluation).groupby(["sequence", "method"]).size()
    graded = set(bins[bins > 2].index.get_level_values("method"))
    return [name for name in evaluation.methods if name in graded]


def error_maps(evaluation: Evaluation, info: SequenceInfo) -> Picture:
    """Draw raw, reference and corrected depth of the last frame of a sequence, each with its error map."""
    reference_m = decoded_thumbnail(info.reference)
    shown = {"raw, as given to the methods": info.raw}
    for method in shown_methods(evaluation):
        thumbnail = evaluation.result(info.name, method).thumbnail
        if thumbnail and method != "raw":
            shown[method] = thumbnail
    scale = _error_scale()
    in_color = partial(_draw_image, f"reference, {FAR_M:g} m and farther blue", colored(reference_m)[..., ::-1], {})
    draws: list[Draw] = [in_color, partial(_draw_scale, scale)]
    for title, png in shown.items():
        depth_m = decoded_thumbnail(png)
        draws.append(partial(_draw_image, title, colored(depth_m)[..., ::-1], {}))
        draws.append(partial(_draw_image, f"error of {title}", error_map(depth_m, reference_m), scale))
    height_in = ERROR_MAP_WIDTH_IN * reference_m.shape[0] / reference_m.shape[1] + 0.3
    n = int(np.count_nonzero(reference_m))
    return Picture(
        title=f"{info.name}, frame {info.frames - 1}",
        caption="Depth is red where near, blue where far, and black where missing. Its error [m] is that against "
        "the reference: red is too far, blue too near, white right, black without depth, and grey without reference; "
        f"n = {n} pixels of a narrowed image.",
        png=panels("", draws, columns=ERROR_MAP_COLUMNS, panel_in=(ERROR_MAP_WIDTH_IN, height_in)),
    )


def error_map(depth_m: FloatImage, reference_m: FloatImage) -> npt.NDArray[np.float32]:
    """Return depth minus reference [m], shape (H, W), cut to the scale of error maps.

    Pixels without depth are `EMPTY_M`, those without a reference NaN.
    """
    error_m = np.where(depth_m > 0, np.clip(depth_m - reference_m, -ERROR_M, ERROR_M), np.float32(EMPTY_M))
    return np.where(reference_m > 0, error_m, np.float32(np.nan)).astype(np.float32)


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the points that no other point is below in one coordinate and not above in the other, by the first one."""
    front: list[tuple[float, float]] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def count_text(count: int) -> str:
    """Write a number of pixels as people read it."""
    if count >= 10**6:
        return f"{count / 10**6:.1f} M"
    return f"{count / 1000:.1f} k" if count >= 1000 else str(count)


def _of_sequence(evaluation: Evaluation, info: SequenceInfo, selector: Selector) -> pd.DataFrame:
    """Select the values and sample sizes of one sequence by method."""
    found = evaluation.measurements.select(selector)
    return found[found.index.get_level_values("sequence") == info.name].droplevel("sequence")


def _right_by_confidence(evaluation: Evaluation) -> pd.DataFrame:
    """Return the share of correct pixels (`value`) of each sequence, method and bin of confidence."""
    selectors = [Selector("right", mask, CALIBRATION_RANGE, FILLED) for mask in CONFIDENCES]
    parts = [evaluation.measurements.select(selector).reset_index() for selector in selectors]
    return pd.concat([part.assign(bin=k) for k, part in enumerate(parts)])


def _panels(evaluation: Evaluation, draw: Callable[[SequenceInfo, "Axes"], None], title: str, caption: str) -> Picture:
    """Draw one panel per sequence, and one legend for all."""
    draws = [partial(draw, info) for info in evaluation.sequences.values()]
    png = panels("", draws, columns=PANEL_COLUMNS, panel_in=PANEL_IN, shared_legend=True)
    return Picture(title=title, caption=caption, png=png)


def _labelled(k: int, name: str) -> dict[str, Any]:
    return {"marker": MARKERS[k % len(MARKERS)], "label": legend_label(name)}


def _draw_image(title: str, image: npt.NDArray[Any], style: Mapping[str, Any], axes: "Axes") -> None:
    axes.imshow(image, **style)
    axes.set_title(title, fontsize=8, parse_math=False)
    axes.set_axis_off()


def _draw_scale(scale: Mapping[str, Any], axes: "Axes") -> None:
    from matplotlib.cm import ScalarMappable

    axes.set_axis_off()
    bar = axes.figure.colorbar(ScalarMappable(**scale), ax=axes, orientation="horizontal", fraction=0.4)
    bar.set_label("error: depth minus reference [m]", fontsize=8)


def _error_scale() -> dict[str, Any]:
    """Return the colours of error maps and the range that they stand for."""
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    colors = colormaps["seismic"].with_extremes(under="black", bad="0.7")
    return {"cmap": colors, "norm": Normalize(-ERROR_M, ERROR_M)}
