"""Measures of the default method on all sequences, each as a table with acceptance criteria."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import pandas as pd

from voxdepth.registry import PAPER

from ..evaluation.groups import ALL
from ..evaluation.measurements import AS_GIVEN, FILLED, Selector, of_frames
from ..evaluation.methods import ORACLE
from ..evaluation.scoring import (
    CALIBRATION_RANGE,
    CONFIDENCES,
    DEPARTED,
    MOVING,
    SOURCES,
    STATIC,
    STATIC_MEASURED,
)
from ..results.table import Column, Table
from .comparison import (
    HOLES,
    RAW,
    SMOOTHER,
    Check,
    Comparison,
    Criterion,
    average,
    change_percent,
    comparison_table,
    ratio,
    worst,
)

STATIONARY = ("sim-hover",)
"""Sequences with a stationary camera, so that a memory saw nothing that the frame does not show."""
MIN_COVERAGE = 0.9
"""Share of the pixels that a baseline must fill for its share of wrong pixels to be comparable."""
SIZES_MS = {"640x360": 5.5, "1024x1024": 30.0}
"""Allowed median time of a frame by its size."""
MIN_PIXELS = 1000
"""Smallest bin of confidence that is compared with its neighbour."""
N = Column("n")


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One measure of the default method."""

    table: Table
    checks: Sequence[Check] = ()


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
        checks=(
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
    closed = pd.Series([gap_closed_percent(*row) for row in errors_m.to_numpy()], errors_m.index, dtype=float)
    columns = {
        Column("default", "m", ".3f"): own,
        Column("best baseline"): best["name"],
        Column("its", "m", ".3f"): best["value"],
        Column(ORACLE, "m", ".3f"): oracle,
        Column("gap closed", "%", ".0f"): closed,
        N: comparison.counts(seen),
    }
    known = errors_m.dropna()
    of_means = pd.Series([gap_closed_percent(*known.mean())]).dropna()
    what = "Holes seen before: share of the gap between the best baseline and true-pose that is closed"
    overall = Criterion(what, 60, "%", at_least=True)
    each = Criterion(f"{what}, each", 60, "%", at_least=True)
    title = "MAE in holes whose surface was measured rightly in the last 60 frames, within 20 m, completed"
    return Measure(
        table=comparison_table(title, "holes-seen", columns),
        checks=(
            Check(overall, next(iter(of_means), None), f"mean errors of {len(known)}"),
            worst(each, closed),
        ),
    )


def gap_closed_percent(own: float, baseline: float, oracle: float) -> float:
    """Share of the gap between the errors of a baseline and of the oracle that a method closes [%].

    It is 0 at the error of the baseline and 100 at that of the oracle; NaN if the oracle is not better.
    """
    return 100 * (baseline - own) / (baseline - oracle) if oracle < baseline else math.nan


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
    return Measure(table=comparison_table(title, "off", columns), checks=(average(criterion, ratios),))


def measured_pixels(comparison: Comparison) -> Measure:
    """Error of pixels that the sensor measured, before and after correction."""
    columns: dict[Column, pd.Series] = {}
    checks = []
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
        checks += [
            worst(Criterion(f"{what}, each", 0, "%"), change),
            average(Criterion(what, bound, "%"), change),
        ]
    columns[N] = comparison.counts(Selector("rmse", "measured", on=FILLED))
    return Measure(table=comparison_table("Measured pixels, surfaces within 20 m", "measured", columns), checks=checks)


def psnr(comparison: Comparison) -> Measure:
    """Peak signal-to-noise ratio with a peak of 40 m, of surfaces within 20 m and of all surfaces."""
    columns: dict[Column, pd.Series] = {}
    checks = []
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
        checks += [
            worst(Criterion(f"{what}, each", 3, "dB", at_least=True), own - paper),
            average(Criterion(what, 6, "dB", at_least=True), own - paper),
        ]
    columns[N] = comparison.counts(Selector("psnr_40m", range=ALL))
    title = "PSNR, peak 40 m, after completion: of surfaces within 20 m, and of all"
    return Measure(table=comparison_table(title, "psnr", columns), checks=checks)


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
        checks=(
            average(Criterion("Flicker of static pixels over raw's", 0.3), ratio_every),
            average(Criterion("Flicker of static, measured pixels over raw's", 0.3), ratio_measured),
            worst(Criterion("Coverage", 99.5, "%", at_least=True), covered),
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
        checks=(
            worst(survives, lost[has_movers]),
            worst(Criterion("Ghosts, less raw's", 1, "points"), added[has_movers]),
        ),
    )


def latency(comparison: Comparison) -> Measure:
    """Time per frame beside that of the reference workload, which runs between the frames."""
    sizes = pd.Series({name: comparison.evaluation.sequences[name].size for name in comparison.sequences})
    p50 = of_frames("latency_p50")
    columns = {
        Column("size"): sizes,
        Column("p50", "ms"): comparison.values(p50),
        Column("p95", "ms"): comparison.values(of_frames("latency_p95")),
        Column("largest", "ms"): comparison.values(of_frames("latency_max")),
        Column("workload", "ms"): comparison.values(of_frames("reference_workload_during")),
        Column("p50", "workloads"): comparison.values(of_frames("latency_p50_workloads")),
        N: comparison.counts(p50),
    }
    rows = [[name, *(values[name] for values in columns.values())] for name in comparison.sequences]
    title = "Time per frame of the default method, OpenCV on one thread"
    return Measure(
        table=Table.of(title, (Column("sequence"), *columns), rows, name="time"),
        checks=[
            worst(
                Criterion(f"Median time of a frame of {size}", bound_ms, "ms"),
                comparison.values(p50)[sizes == size],
            )
            for size, bound_ms in SIZES_MS.items()
        ],
    )


def confidence(comparison: Comparison) -> Measure:
    """Share of right pixels by confidence."""
    shares = [pooled(comparison, "right", mask) for mask in CONFIDENCES]
    criterion = Criterion("Largest fall of the share of right pixels where confidence rises", 0, "points")
    check = Check(criterion, largest_fall(shares), f"bins of {MIN_PIXELS} pixels and more")
    title = f"Pixels by confidence, and how many are right (5 % or 0.25 px), {CALIBRATION_RANGE}, all sequences"
    return Measure(table=_pooled_table(comparison, CONFIDENCES, title, "confidence"), checks=(check,))


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
    """The largest fall of the share of right pixels from one bin to the next with a higher confidence [points].

    Args:
        shares: Share of right pixels, 0..1, and number of pixels, by rising confidence.

    Returns:
        Below 0 if the share rises everywhere; None with less than two bins of enough pixels.
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
    error_in_holes, error_in_seen_holes, wrong_pixels, measured_pixels, psnr, flicker, moving_objects, latency,
    confidence, source,
)  # fmt: skip
