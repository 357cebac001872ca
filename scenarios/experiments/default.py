"""The default method against all baselines on the same frames: measures as tables, with acceptance criteria."""

import math
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.registry import PAPER
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import Source

from ..evaluation.groups import ALL
from ..evaluation.measurements import AS_GIVEN, FILLED, Selector, of_frames
from ..evaluation.methods import METHOD_NAMES, ORACLE, find_methods
from ..evaluation.scoring import (
    CALIBRATION_RANGE,
    CONFIDENCES,
    DEPARTED,
    MOVING,
    PHANTOMS,
    SKY_NEAR,
    SKY_RANGE_M,
    SOURCES,
    STATIC,
    STATIC_MEASURED,
    in_bin,
)
from ..results.figure import grouped_bars, label_axes, panels
from ..sequences import GROUPS
from .comparison import (
    HOLES,
    RAW,
    SMOOTHER,
    Comparison,
    Criterion,
    average,
    change_percent,
    comparison_table,
    criteria_table,
    ratio,
    worst,
)
from .experiment import Experiment, ExperimentContext, Findings

STATIONARY = ("sim-hover",)
"""Sequences with a stationary camera, so that a memory saw nothing that the frame does not show."""
MIN_COVERAGE = 0.9
"""Share of the pixels that a baseline must fill for its share of wrong pixels to be comparable."""
SIZES_MS = {"640x360": 5.5, "1024x1024": 30.0}
"""Allowed median time of a frame by its size."""
MIN_PIXELS = 1000
"""Smallest bin of confidence that is compared with its neighbour."""
PANEL_SEQUENCES = 6
"""Sequences in a panel of the figure."""
NOTES = (
    "Baselines are all methods but voxdepth, paper and true-pose; true-pose splats the last frames by the true pose, "
    "which bounds what a memory can know. The best baseline is chosen for each sequence and each measure.",
    "The default method was tuned on seed 101, with a look at 102 and 103, so results of these seeds prove nothing. "
    "Those of seed 0, the default, and of any other are fair. Another seed needs another --out, or it replaces the "
    "results there.",
    "The default method leaves a pixel empty where its guess is unlikely (fill = likely). Errors after completion are "
    "those of `voxdepth[fill=all]`, which shows a depth at every pixel; all else is of the default. Coverage is a "
    "result and has no bound.",
    "Every sequence has the same weight in a mean. An undefined value shows as - and is in no mean; the closed share "
    "of the gap is undefined where true-pose is not better than the best baseline.",
    "Surfaces beyond the sensor's largest depth (40 m) have no measurement to correct, and their errors dominate a "
    "PSNR of all surfaces: hence the PSNR within 20 m beside it.",
    "Flicker is |change of the error| from frame to frame where the same surface stays, of pixels with a depth in both "
    "frames. Raw has none in holes: `measured` compares the two on the same pixels.",
    "A camera that turns on the spot (sim-yaw) has no parallax; the criteria are the same as for those that move.",
    "Times depend on this machine and on its load: the reference workload (a 5x5 median of 640x360 pixels) shows the "
    "load, unless it is short enough to run between other work. `voxdepth bench`, alone on the machine, measures "
    "speed, p99 and memory.",
)
N = Column("n")


class Measure(NamedTuple):
    """One measure of the default method."""

    table: Table
    criteria: Sequence[Criterion] = ()


def error_in_holes(comparison: Comparison) -> Measure:
    """Mean error of pixels that the sensor did not measure."""
    own, smoother = comparison.values(HOLES), comparison.values(HOLES, SMOOTHER)
    best, best_of_all = comparison.best(HOLES, without=[SMOOTHER]), comparison.best(HOLES)
    to_best, to_smoother = change_percent(own, best["value"]), change_percent(own, smoother)
    to_any = change_percent(own, best_of_all["value"])
    stationary = to_any.index.isin(STATIONARY)
    columns = {
        Column("default", "m", ".3f"): own,
        Column("best baseline but smoother"): best["name"],
        Column("its", "m", ".3f"): best["value"],
        Column(SMOOTHER, "m", ".3f"): smoother,
        Column("against best", "%", ".1f"): to_best,
        Column("against smoother", "%", ".1f"): to_smoother,
        **{Column(name, "m", ".3f"): comparison.values(HOLES, name) for name in (ORACLE, PAPER, RAW)},
        N: comparison.counts(HOLES),
    }
    what = "MAE in holes against"
    return Measure(
        table=comparison_table("MAE in holes, surfaces within 20 m, after completion", "holes", columns),
        criteria=(
            average(Criterion(f"{what} the best baseline but the smoother", -35, "%"), to_best),
            average(Criterion(f"{what} the global smoother", -20, "%"), to_smoother),
            worst(Criterion(f"{what} the best baseline, moving camera", 0, "%"), to_any[~stationary]),
            worst(Criterion(f"{what} the best baseline, hover", 5, "%"), to_any[stationary]),
        ),
    )


def error_in_seen_holes(comparison: Comparison) -> Measure:
    """Share of the gap between the best baseline and the oracle that the default method closes."""
    seen = Selector("mae", "holes seen")
    own, best, oracle = comparison.values(seen), comparison.best(seen), comparison.values(seen, ORACLE)
    errors_m = pd.DataFrame({"own": own, "baseline": best["value"], "oracle": oracle})
    closed = gap_closed_percent(errors_m)
    columns = {
        Column("default", "m", ".3f"): own,
        Column("best baseline"): best["name"],
        Column("its", "m", ".3f"): best["value"],
        Column(ORACLE, "m", ".3f"): oracle,
        Column("gap closed", "%", ".0f"): closed,
        N: comparison.counts(seen),
    }
    known = errors_m.dropna()
    of_means = gap_closed_percent(known.mean().to_frame().T).dropna()
    what = "Holes seen before: share of the gap between the best baseline and true-pose that is closed"
    scope = f"mean errors of {len(known)}"
    overall = Criterion(what, 60, "%", at_least=True, value=next(iter(of_means), None), scope=scope)
    title = "MAE in holes whose surface was measured rightly in the last 60 frames, within 20 m, completed"
    return Measure(
        table=comparison_table(title, "holes-seen", columns),
        criteria=(overall, worst(Criterion(f"{what}, each", 60, "%", at_least=True), closed)),
    )


def gap_closed_percent(errors: pd.DataFrame) -> pd.Series:
    """Share of the gap between the errors of a baseline and of the oracle that a method closes [%], by row.

    It is 0 at the error of the baseline and 100 at that of the oracle; NaN if the oracle is not better. The columns are
    `own`, `baseline` and `oracle`.
    """
    gap = errors["baseline"] - errors["oracle"]
    return 100 * (errors["baseline"] - errors["own"]) / gap.where(gap > 0)


def wrong_pixels(comparison: Comparison) -> Measure:
    """Share of pixels that are too far or too near; a bias improves either one alone."""
    far, near, off = (Selector(metric, "holes") for metric in ("too_far", "too_near", "off"))
    best = comparison.best(off, min_coverage=MIN_COVERAGE)
    ratios = ratio(comparison.values(off), best["value"])
    columns = {
        Column("too far", "%", ".1f"): 100 * comparison.values(far),
        Column("too near", "%", ".1f"): 100 * comparison.values(near),
        Column("off", "%", ".1f"): 100 * comparison.values(off),
        Column("best baseline that fills"): best["name"],
        Column("its off", "%", ".1f"): 100 * best["value"],
        Column("ratio"): ratios,
        N: comparison.counts(off),
    }
    criterion = Criterion("Holes more than 10 % off, over those of the best baseline that fills 90 %", 0.7)
    title = "Holes more than 10 % too far or too near (off), within 20 m, after completion"
    return Measure(table=comparison_table(title, "off", columns), criteria=(average(criterion, ratios),))


def measured_pixels(comparison: Comparison) -> Measure:
    """Error of pixels that the sensor measured, before and after correction."""
    columns: dict[Column, pd.Series] = {}
    criteria = []
    quantities = (("RMSE", "rmse", "m", ".3f", 1, "RMSE", -20),
                  ("median", "median", "mm", ".1f", 1000, "Median error", -35))  # fmt: skip
    for name, metric, unit, number, factor, title, bound in quantities:
        selector = Selector(metric, "measured", on=FILLED)
        own, raw = comparison.values(selector), comparison.values(selector, RAW)
        change = change_percent(own, raw)
        columns |= {
            Column(f"{name} raw", unit, number): factor * raw,
            Column(f"{name} default", unit, number): factor * own,
            Column(f"{name} change", "%", ".1f"): change,
        }
        what = f"{title} of measured pixels against raw"
        criteria += [
            worst(Criterion(f"{what}, each", 0, "%"), change),
            average(Criterion(what, bound, "%"), change),
        ]
    columns[N] = comparison.counts(Selector("rmse", "measured", on=FILLED))
    return Measure(
        table=comparison_table("Measured pixels, surfaces within 20 m", "measured", columns), criteria=criteria
    )


def psnr(comparison: Comparison) -> Measure:
    """Peak signal-to-noise ratio with a peak of 40 m, of surfaces within 20 m and of all surfaces."""
    columns: dict[Column, pd.Series] = {}
    criteria = []
    for short, where, selector in (
        ("20 m", "within 20 m", Selector("psnr_40m")),
        ("all", "of all surfaces", Selector("psnr_40m", range=ALL)),
    ):
        own, paper = comparison.values(selector), comparison.values(selector, PAPER)
        columns |= {
            Column(f"raw {short}", "dB"): comparison.values(selector, RAW),
            Column(f"paper {short}", "dB"): paper,
            Column(f"default {short}", "dB"): own,
            Column(f"gain {short}", "dB"): own - paper,
        }
        what = f"PSNR {where} above paper's"
        criteria += [
            worst(Criterion(f"{what}, each", 3, "dB", at_least=True), own - paper),
            average(Criterion(what, 6, "dB", at_least=True), own - paper),
        ]
    columns[N] = comparison.counts(Selector("psnr_40m", range=ALL))
    title = "PSNR, peak 40 m, after completion: of surfaces within 20 m, and of all"
    return Measure(table=comparison_table(title, "psnr", columns), criteria=criteria)


def flicker(comparison: Comparison) -> Measure:
    """Change of the error where nothing moves, and the share of pixels with a depth."""
    every, measured = (Selector("flicker", mask, on=FILLED) for mask in (STATIC, STATIC_MEASURED))
    coverage = Selector("coverage", range=ALL, on=FILLED)
    ratio_every, ratio_measured = (
        ratio(comparison.values(selector), comparison.values(selector, RAW)) for selector in (every, measured)
    )
    covered = 100 * comparison.values(coverage)
    columns = {
        Column("raw", "mm", ".1f"): 1000 * comparison.values(every, RAW),
        Column("default", "mm", ".1f"): 1000 * comparison.values(every),
        Column("ratio"): ratio_every,
        Column("default, measured", "mm", ".1f"): 1000 * comparison.values(measured),
        Column("ratio, measured"): ratio_measured,
        Column("coverage raw", "%", ".1f"): 100 * comparison.values(coverage, RAW),
        Column("coverage default", "%"): covered,
        N: comparison.counts(every),
    }
    title = "Flicker of static pixels within 20 m; measured: of those that the sensor measured in both frames; coverage"
    return Measure(
        table=comparison_table(title, "flicker", columns),
        criteria=(
            average(Criterion("Flicker of static pixels over raw's", 0.3), ratio_every),
            average(Criterion("Flicker of static, measured pixels over raw's", 0.3), ratio_measured),
        ),
    )


def moving_objects(comparison: Comparison) -> Measure:
    """Survival of moving objects and of their ghosts, on the sequences that have moving objects."""
    survival, survival_raw = (Selector(name, MOVING, ALL, AS_GIVEN) for name in ("survival", "survival_raw"))
    ghosts, ghosts_raw = (Selector(name, DEPARTED, ALL, FILLED) for name in ("ghosts", "ghosts_raw"))
    lost = 100 * (comparison.values(survival) - comparison.values(survival_raw))
    added = 100 * (comparison.values(ghosts) - comparison.values(ghosts_raw))
    columns = {
        Column("survival raw", "%", ".1f"): 100 * comparison.values(survival_raw),
        Column("default", "%", ".1f"): 100 * comparison.values(survival),
        Column("difference", "points", ".1f"): lost,
        Column("n moving"): comparison.counts(survival),
        Column("ghosts raw", "%", ".1f"): 100 * comparison.values(ghosts_raw),
        Column("ghosts default", "%", ".1f"): 100 * comparison.values(ghosts),
        Column("ghosts more", "points", ".1f"): added,
        Column("n departed"): comparison.counts(ghosts),
    }
    has_movers = comparison.counts(survival) > 0
    title = "Things that move: pixels within 5 % of the truth; ghosts of them 5 frames later"
    survives = Criterion("Survival of what moves, less raw's", -1, "points", at_least=True)
    return Measure(
        table=comparison_table(title, "movers", {column: values[has_movers] for column, values in columns.items()}),
        criteria=(
            worst(survives, lost[has_movers]),
            worst(Criterion("Ghosts, less raw's", 1, "points"), added[has_movers]),
        ),
    )


def false_obstacles(comparison: Comparison) -> Measure:
    """Share of the sky that is shown near, and number of phantom obstacles."""
    sky, phantoms = 100 * comparison.values(SKY_NEAR), comparison.values(PHANTOMS)
    columns = {
        Column(f"sky within {SKY_RANGE_M:g} m raw", "%", ".1f"): 100 * comparison.values(SKY_NEAR, RAW),
        Column("default", "%", ".1f"): sky,
        Column("n sky"): comparison.counts(SKY_NEAR),
        Column("phantoms raw", "", ".0f"): comparison.values(PHANTOMS, RAW),
        Column("phantoms default", "", ".0f"): phantoms,
        Column("n frames"): comparison.counts(PHANTOMS),
    }
    title = "Sky that is shown near; phantoms: blobs of 30 px nearer than half the true depth that stay for 5 frames"
    stationary = phantoms[phantoms.index.isin(STATIONARY)]
    return Measure(
        table=comparison_table(title, "false-obstacles", columns),
        criteria=(
            worst(Criterion(f"Sky shown within {SKY_RANGE_M:g} m", 1, "%"), sky),
            worst(Criterion("Phantom obstacles, hover", 0), stationary),
        ),
    )


def latency(comparison: Comparison) -> Measure:
    """Time per frame beside that of the reference workload, which runs between the frames."""
    sizes = pd.Series({name: comparison.evaluation.sequences[name].size for name in comparison.sequences})
    p50_ms = comparison.values(of_frames("latency_p50"))
    columns = {
        Column("size"): sizes,
        Column("p50", "ms"): p50_ms,
        Column("p95", "ms"): comparison.values(of_frames("latency_p95")),
        Column("largest", "ms"): comparison.values(of_frames("latency_max")),
        Column("workload", "ms"): comparison.values(of_frames("reference_workload_during")),
        Column("p50", "workloads"): comparison.values(of_frames("latency_p50_workloads")),
        N: comparison.counts(of_frames("latency_p50")),
    }
    rows = [[name, *(values[name] for values in columns.values())] for name in comparison.sequences]
    title = "Time per frame of the default method, OpenCV on one thread"
    return Measure(
        table=Table.of(title, (Column("sequence"), *columns), rows, name="time"),
        criteria=[
            worst(Criterion(f"Median time of a frame of {size}", bound_ms, "ms"), p50_ms[sizes == size])
            for size, bound_ms in SIZES_MS.items()
        ],
    )


def confidence(comparison: Comparison) -> Measure:
    """Share of right pixels by confidence."""
    shares = [pooled(comparison, "right", mask) for mask in CONFIDENCES]
    what = "Largest fall of the share of right pixels where confidence rises"
    scope = f"bins of {MIN_PIXELS} pixels and more"
    criterion = Criterion(what, 0, "points", value=largest_fall(shares), scope=scope)
    title = f"Pixels by confidence, and how many are right (5 % or 0.25 px), {CALIBRATION_RANGE}, all sequences"
    return Measure(table=_pooled_table(comparison, CONFIDENCES, title, "confidence"), criteria=(criterion,))


def confidence_in_holes(comparison: Comparison) -> Measure:
    """Share of right pixels by confidence in holes, and of those that are from the memory and from inpainting."""
    masks = {"holes": "holes", "memory": SOURCES[Source.MEMORY], "inpainted": SOURCES[Source.INPAINTED]}
    shares = {
        name: [pooled(comparison, "right", in_bin(mask, one)) for one in CONFIDENCES] for name, mask in masks.items()
    }
    columns = [Column("confidence")]
    rows: list[list[Value]] = [[one.removeprefix("confidence ")] for one in CONFIDENCES]
    for name, of_bins in shares.items():
        columns += [Column(f"right, {name}", "%", ".1f"), Column(f"n, {name}")]
        for row, (share, n) in zip(rows, of_bins, strict=True):
            row += [None if share is None else 100 * share, n]
    scope = f"bins of {MIN_PIXELS} pixels and more"
    what = "Largest fall of the share of right pixels where confidence rises"
    criteria = [
        Criterion(f"{what}, {name}", 0, "points", value=largest_fall(of_bins), scope=scope)
        for name, of_bins in shares.items()
    ]
    title = f"Pixels in holes and of two sources by confidence, and how many are right, {CALIBRATION_RANGE}"
    return Measure(table=Table.of(title, columns, rows, name="confidence-in-holes"), criteria=criteria)


def source(comparison: Comparison) -> Measure:
    """Share of right pixels by the source of their depth."""
    title = f"Pixels by where the depth is from, and how many are right, {CALIBRATION_RANGE}, all sequences"
    return Measure(table=_pooled_table(comparison, list(SOURCES.values()), title, "source"))


def pooled(comparison: Comparison, metric: str, mask: str) -> tuple[float | None, int]:
    """The mean of a metric over the pixels of all sequences, and their number."""
    selector = Selector(metric, mask, CALIBRATION_RANGE, FILLED)
    values, counts = comparison.values(selector), comparison.counts(selector)
    n = sum(counts)
    total = sum(value * count for value, count in zip(values, counts, strict=True) if not math.isnan(value))
    return (total / n if n else None), n


def largest_fall(shares: Sequence[tuple[float | None, int]]) -> float | None:
    """The largest fall of the share of right pixels (0..1, with their number) from one bin of confidence to the next.

    It is in percentage points, below 0 if the share rises everywhere, and None with less than two large enough bins.
    """
    known = [share for share, n in shares if share is not None and n >= MIN_PIXELS]
    falls = [100 * (lower - higher) for lower, higher in pairwise(known)]
    return max(falls) if falls else None


def _pooled_table(comparison: Comparison, masks: Sequence[str], title: str, name: str) -> Table:
    columns = (name, Column("right", "%", ".1f"), Column("MAE", "m", ".3f"), Column("pixels", "%"), N)
    shares = {mask: pooled(comparison, "right", mask) for mask in masks}
    total = sum(n for _, n in shares.values())
    rows = [
        (mask.removeprefix(f"{name} "), None if share is None else 100 * share, pooled(comparison, "mae", mask)[0],
         100 * n / total if n else 0.0, n)
        for mask, (share, n) in shares.items()
    ]  # fmt: skip
    return Table.of(title, columns, rows, name=name)


MEASURES = (
    error_in_holes, error_in_seen_holes, wrong_pixels, measured_pixels, psnr, flicker, moving_objects,
    false_obstacles, latency, confidence, confidence_in_holes, source,
)  # fmt: skip


def compare_default(context: ExperimentContext) -> Findings:
    """Evaluate all methods and apply every measure to the default method."""
    comparison = Comparison(context.evaluate(find_methods(METHOD_NAMES)))
    measures = [measure(comparison) for measure in MEASURES]
    starts = range(0, len(comparison.sequences), PANEL_SEQUENCES)
    parts = [comparison.sequences[start : start + PANEL_SEQUENCES] for start in starts]
    title = f"MAE in holes within 20 m, after completion, n = {context.frames} frames of each sequence"
    return Findings(
        tables=(
            criteria_table([found for one in measures for found in one.criteria]),
            *(one.table for one in measures),
        ),
        notes=NOTES,
        figure=panels(title, [partial(_draw, comparison, part) for part in parts]),
    )


def _draw(comparison: Comparison, sequences: list[str], axes: Axes) -> None:
    best = comparison.best(HOLES, without=[SMOOTHER])["value"]
    others = {name: comparison.values(HOLES, name) for name in (SMOOTHER, ORACLE, PAPER, RAW)}
    series = {comparison.own(HOLES): comparison.values(HOLES), "best baseline but smoother": best, **others}
    label_axes(axes, f"best baseline of each sequence; {ORACLE} is a bound", "sequence", "MAE in holes [m]")
    grouped_bars(axes, sequences, {name: list(values[sequences]) for name, values in series.items()})


DEFAULT_METHOD = Experiment(
    "default", "Is the default method better than every baseline, and does it meet its acceptance criteria?",
    compare_default, (*GROUPS["reference"], *GROUPS["hard"]), frames=40, min_frames=2,
)  # fmt: skip
