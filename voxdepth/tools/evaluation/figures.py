"""The figures of the report: every axis has its unit, every panel its sample size."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from ... import registry
from ...colors import colored, far_end_m
from ...types import FloatImage
from ..figure import MARKERS, Picture, image_shown, label_axes, legend_label, line_color, log_scale, panels
from .groups import BINS, NEAR
from .measurements import FILLED, Selector, of_frames
from .methods import ORACLE
from .result_cache import SequenceInfo, decoded_thumbnail
from .scoring import CALIBRATION_RANGE, CONFIDENCES
from .suite import Evaluation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = ("raw", "voxdepth", "temporal", "realsense", "lmeds", "ip-basic", "global-smoother", ORACLE, "learned")
"""Methods that lines and points are drawn of where more took part; if none of these did, the first ones that did."""
PANEL_COLUMNS, PANEL_IN, WIDEST_PANEL_IN = 3, (4.3, 3.5), 7.0
"""Panels side by side, their width and height, and the width of the panel of a single sequence."""
ERROR_MAP_COLUMNS, ERROR_MAP_WIDTH_IN = 4, 2.6
ERROR_SHARE = 0.08
"""End of the scale of error maps, as a share of that of the depth beside them."""


def all_figures(evaluation: Evaluation) -> list[Picture]:
    """Draw the figures about numbers; panels and figures that nothing was measured for are left out."""
    draws = (error_against_range, error_against_latency, reliability)
    return [picture for draw in draws for picture in draw(evaluation)]


def shown_methods(evaluation: Evaluation) -> list[str]:
    """Return the methods that figures are drawn of: all if they are few."""
    present = list(dict.fromkeys(result.key.method for result in evaluation.results if result.error is None))
    if len(present) <= len(SHOWN):
        return present
    return [name for name in SHOWN if name in present] or present[: len(SHOWN)]


def error_against_range(evaluation: Evaluation) -> list[Picture]:
    """Draw the mean absolute error by range, one panel per sequence."""
    styles, methods = _styles(evaluation), shown_methods(evaluation)

    def data_of(info: SequenceInfo) -> pd.DataFrame:
        """The errors [m] of the methods (columns) by bin."""
        found = evaluation.measurements.table({name: Selector("mae", info.independent, name) for name in BINS})
        values = found.loc[info.name].T.reset_index(drop=True).reindex(columns=methods)
        return values[values > 0].dropna(axis=0, how="all").dropna(axis=1, how="all")

    def draw(info: SequenceInfo, values: pd.DataFrame, axes: "Axes") -> None:
        mask, first, last = info.independent, values.index.min(), values.index.max()
        for name in values:
            axes.plot(values[name].dropna(), ms=4, **styles[name])
        counts = [f"{name}\n{count_text(info.pixels[mask].get(name, 0))}" for name in BINS[first : last + 1]]
        axes.set_xticks(range(first, last + 1), counts, fontsize=7)
        axes.set_xlim(first - 0.3, last + 0.3)
        log_scale(axes, "y")
        depth = f"depth by {info.reference_name}" if mask == "all" else f"depth of held-out {mask.replace('-', ' ')}"
        label_axes(axes, info.name, f"{depth}, and pixels n", "MAE [m]")

    caption = (
        "The mean absolute error after completion by the nearest valid pixel is that of all pixels by their true depth "
        "or, without the truth, that of held-out pixels by their measured depth; n is the number of pixels of a bin "
        "over all frames."
    )
    return _panels(evaluation, data_of, draw, "Error against range", caption)


def error_against_latency(evaluation: Evaluation) -> list[Picture]:
    """Draw error against time, one panel per sequence, with the Pareto front."""
    styles = _styles(evaluation)

    def data_of(info: SequenceInfo) -> pd.DataFrame:
        """Time [ms] and error [m] of the methods that have both."""
        latencies = {name: of_frames(f"latency_{name}") for name in ("p50", "background")}
        found = evaluation.measurements.table(latencies | {"error": Selector("mae", info.hidden)}).loc[info.name]
        time_ms = found["p50"].add(found["background"], fill_value=0)
        return pd.DataFrame({"time": time_ms, "error": found["error"]}).dropna()

    def draw(info: SequenceInfo, points: pd.DataFrame, axes: "Axes") -> None:
        for name, x_ms, y_m in points.itertuples(name=None):
            axes.scatter([x_ms], [y_m], s=22, **styles[name])
        if front := pareto_front(list(points.drop(ORACLE, errors="ignore").itertuples(index=False, name=None))):
            axes.plot(*zip(*front, strict=True), color="0.6", lw=1, zorder=0)
        log_scale(axes, "x")
        log_scale(axes, "y")
        n = count_text(info.pixels[info.hidden].get(NEAR, 0))
        x = f"time per frame of {info.size} [ms], n = {info.frames}"
        label_axes(axes, info.name, x, f"MAE in {info.hidden.replace('-', ' ')} [m],\nn = {n} pixels")

    caption = (
        "The error is the mean absolute error after completion of surfaces within 20 m where the sensor has no depth, "
        "or where its depth was held out. The time is the median time per frame with OpenCV on one thread plus the "
        "mean CPU time of the method's own threads. The grey line is the Pareto front: no method beats these in both. "
        f"{ORACLE} is an oracle and does not compete."
    )
    return _panels(evaluation, data_of, draw, "Error against latency", caption)


def reliability(evaluation: Evaluation) -> list[Picture]:
    """Draw the share of correct pixels by confidence, one panel per sequence."""
    correct, shown, styles = _correct_by_confidence(evaluation), shown_methods(evaluation), _styles(evaluation)
    correct = correct[correct["method"].isin(set(calibrated_methods(evaluation)) & set(shown))]

    def draw(info: SequenceInfo, bins_of_all: pd.DataFrame, axes: "Axes") -> None:
        totals = bins_of_all.groupby("method")["n"].sum()
        for name, bins in bins_of_all.groupby("method", sort=False):
            x = np.maximum(0, (bins["bin"] - 0.5) / 10)
            axes.plot(x, 100 * bins["value"], ms=4, **styles[str(name)])
            axes.plot(x, 100 * bins["n"] / totals[name], ":", color=styles[str(name)]["color"], lw=0.8)
        axes.set(xlim=(-0.03, 1), ylim=(0, 100))
        n = range_text(int(totals.min()), int(totals.max()))
        label_axes(axes, info.name, f"confidence, n = {n} pixels", "pixels that are correct [%]")

    caption = (
        f"Pixels that a method gives a depth, {CALIBRATION_RANGE}, are sorted into bins of confidence of width 0.1, "
        "and a bin for 0. Lines show the share of a bin that is correct, within 5 % or a quarter of a pixel of "
        "disparity; dotted lines show the share of the method's pixels that are in the bin. A rising line means that "
        "the confidence can be trusted. Methods whose pixels are in one or two bins are left out, and where more than "
        f"{len(SHOWN)} took part, those that the other figures leave out; n is the number of pixels of a method."
    )
    return _panels(
        evaluation, lambda info: correct[correct["sequence"] == info.name], draw, "Confidence against errors", caption
    )


def calibrated_methods(evaluation: Evaluation) -> list[str]:
    """Return the methods whose confidence fills more than two bins: two only tell measured from filled pixels."""
    bins = _correct_by_confidence(evaluation).groupby(["sequence", "method"]).size()
    calibrated = set(bins[bins > 2].index.get_level_values("method"))
    return [name for name in evaluation.methods if name in calibrated]


def error_maps(evaluation: Evaluation) -> list[Picture]:
    """Draw the depth and the errors of the last frame of each sequence that has a reference there."""
    infos = evaluation.sequences.values()
    return [_error_maps(evaluation, info) for info in infos if decoded_thumbnail(info.reference).any()]


def _error_maps(evaluation: Evaluation, info: SequenceInfo) -> Picture:
    """Draw raw and corrected depth of the last frame of a sequence, each with its error map, and the reference."""
    reference_m = decoded_thumbnail(info.reference)
    thumbnails = {method: evaluation.result(info.name, method).thumbnail for method in shown_methods(evaluation)}
    shown = {"raw, as given to the methods": info.raw}
    shown |= {registry.title(method): png for method, png in thumbnails.items() if png and method != "raw"}
    far_m = far_end_m([reference_m, decoded_thumbnail(info.raw)])
    end_m = ERROR_SHARE * far_m
    ramp_m = np.tile(np.linspace(-end_m, end_m, 240, dtype=np.float32), (24, 1))
    images: dict[str, npt.NDArray[Any]] = {
        "reference": colored(reference_m, far_m)[..., ::-1],
        f"error from -{end_m:g} to {end_m:g} m": error_map(2 * end_m + ramp_m, np.full_like(ramp_m, 2 * end_m), end_m),
    }
    for title, png in shown.items():
        depth_m = decoded_thumbnail(png)
        images[title] = colored(depth_m, far_m)[..., ::-1]
        images[f"error of {title}"] = error_map(depth_m, reference_m, end_m)
    height_in = ERROR_MAP_WIDTH_IN * reference_m.shape[0] / reference_m.shape[1] + 0.3
    draws = [image_shown(title, image) for title, image in images.items()]
    return Picture(
        title=f"{info.name}, frame {info.frames - 1}",
        caption=f"Depth is red where near, blue at {far_m:g} m and beyond, and black where missing. Its error is that "
        f"against the reference: red is too far by up to {end_m:g} m and more, blue too near, white correct, black "
        f"without depth, and grey without reference; n = {np.count_nonzero(reference_m)} pixels of a narrowed image.",
        png=panels("", draws, columns=ERROR_MAP_COLUMNS, panel_in=(ERROR_MAP_WIDTH_IN, height_in)),
    )


def error_map(depth_m: FloatImage, reference_m: FloatImage, end_m: float) -> npt.NDArray[np.float64]:
    """Return depth minus reference [m] in colours, RGB, shape (H, W, 3), on a scale from `-end_m` to `end_m`.

    Pixels without depth are black, those without a reference grey.
    """
    from matplotlib import colormaps

    colors = colormaps["bwr"](0.5 + (depth_m - reference_m) / (2 * end_m))[..., :3]
    colors[depth_m == 0] = 0.0
    colors[reference_m == 0] = 0.7
    return np.asarray(colors)


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


def range_text(low: int, high: int) -> str:
    """Write the smallest and the largest of some numbers of pixels as people read them."""
    return " to ".join(dict.fromkeys((count_text(low), count_text(high))))


def _styles(evaluation: Evaluation) -> dict[str, dict[str, Any]]:
    """Return colour, marker and label of each method: the same in all figures, for those of `SHOWN` in all reports."""
    return {
        name: {"color": line_color(k), "marker": MARKERS[k % len(MARKERS)], "label": legend_label(registry.title(name))}
        for k, name in enumerate(dict.fromkeys((*SHOWN, *evaluation.methods)))
    }


def _correct_by_confidence(evaluation: Evaluation) -> pd.DataFrame:
    """Return the share of correct pixels (`value`) of each sequence, method and bin of confidence."""
    selectors = [Selector("correct", mask, CALIBRATION_RANGE, FILLED) for mask in CONFIDENCES]
    parts = [evaluation.measurements.select(selector).reset_index() for selector in selectors]
    return pd.concat([part.assign(bin=k) for k, part in enumerate(parts)])


def _panels(
    evaluation: Evaluation,
    data_of: Callable[[SequenceInfo], pd.DataFrame],
    draw: Callable[[SequenceInfo, pd.DataFrame, "Axes"], None],
    title: str,
    caption: str,
) -> list[Picture]:
    """Draw one panel per sequence that has data, and one legend for all; nothing if none has any."""
    data = [(info, data_of(info)) for info in evaluation.sequences.values()]
    draws = [partial(draw, info, found) for info, found in data if not found.empty]
    if not draws:
        return []
    width_in = min(WIDEST_PANEL_IN, PANEL_IN[0] * PANEL_COLUMNS / min(PANEL_COLUMNS, len(draws)))
    png = panels("", draws, columns=PANEL_COLUMNS, panel_in=(width_in, PANEL_IN[1]), shared_legend=True)
    return [Picture(title=title, caption=caption, png=png)]
