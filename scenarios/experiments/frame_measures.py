"""What the default method is measured by in whole frames: pixels that had a depth, noise, flicker, movers, time."""

from collections.abc import Sequence

from voxdepth.registry import DEFAULT, PAPER

from ..evaluation.groups import ALL
from ..evaluation.measurements import AS_GIVEN, FILLED, FRAMES
from ..evaluation.scoring import DEPARTED, MOVING, STATIC, STATIC_MEASURED
from .bars import Bar, Values, average, worst
from .hole_measures import SEQUENCE, Measured, N
from .result import Column, Table, Value
from .standing import RAW, Reading, Standing, change_percent, less, ratio, scaled, with_mean

SIZES_MS = {"640x360": 5.5, "1024x1024": 30.0}
"""Time that a frame may take, by its size."""


def of_measured_pixels(standings: Sequence[Standing]) -> Measured:
    """What correction does to pixels that had a depth."""
    rmse, median = (Reading(metric=metric, mask="measured", on=FILLED) for metric in ("rmse", "median"))
    columns = (SEQUENCE, Column(name="RMSE raw", unit="m", places=3), Column(name="RMSE default", unit="m", places=3),
               Column(name="RMSE change", unit="%", places=1), Column(name="median raw", unit="mm", places=1),
               Column(name="median default", unit="mm", places=1), Column(name="median change", unit="%", places=1),
               N)  # fmt: skip
    rmse_changes, median_changes = (
        {at.sequence: change_percent(at.value(reading), at.value(reading, RAW)) for at in standings}
        for reading in (rmse, median)
    )
    rows = [
        (at.sequence, at.value(rmse, RAW), at.value(rmse), rmse_changes[at.sequence],
         scaled(at.value(median, RAW), 1000), scaled(at.value(median), 1000), median_changes[at.sequence],
         at.count(rmse))
        for at in standings
    ]  # fmt: skip
    return Measured(
        table=Table.of("Measured pixels, surfaces within 20 m", columns, with_mean(rows), "measured"),
        findings=(
            worst(Bar(what="RMSE of measured pixels against raw, each", bound=0, unit="%"), rmse_changes),
            average(Bar(what="RMSE of measured pixels against raw", bound=-20, unit="%"), rmse_changes),
            worst(Bar(what="Median error of measured pixels against raw, each", bound=0, unit="%"), median_changes),
            average(Bar(what="Median error of measured pixels against raw", bound=-35, unit="%"), median_changes),
        ),
    )


def of_psnr(standings: Sequence[Standing]) -> Measured:
    """Signal against noise, peak 40 m: within 20 m, and of all surfaces."""
    within_20_m, of_all = Reading(metric="psnr_40m"), Reading(metric="psnr_40m", within=ALL)
    names = [f"{method} {where}" for where in ("20 m", "all") for method in ("raw", "paper", "default", "gain")]
    columns = (SEQUENCE, *(Column(name=name, unit="dB") for name in names), N)
    near, whole = (
        {at.sequence: less(at.value(reading), at.value(reading, PAPER)) for at in standings}
        for reading in (within_20_m, of_all)
    )
    rows = [
        (at.sequence, *(at.value(within_20_m, name) for name in (RAW, PAPER, DEFAULT)), near[at.sequence],
         *(at.value(of_all, name) for name in (RAW, PAPER, DEFAULT)), whole[at.sequence], at.count(of_all))
        for at in standings
    ]  # fmt: skip
    findings = []
    for where, gains in (("within 20 m", near), ("of all surfaces", whole)):
        what = f"PSNR {where} above paper's"
        findings += [
            worst(Bar(what=f"{what}, each", bound=3, unit="dB", at_least=True), gains),
            average(Bar(what=what, bound=6, unit="dB", at_least=True), gains),
        ]
    title = "PSNR, peak 40 m, after completion: of surfaces within 20 m, and of all"
    return Measured(table=Table.of(title, columns, with_mean(rows), "psnr"), findings=findings)


def of_flicker(standings: Sequence[Standing]) -> Measured:
    """Change of the error where nothing changes, and how much of the image has a depth."""
    every, measured = (Reading(metric="flicker", mask=mask, on=FILLED) for mask in (STATIC, STATIC_MEASURED))
    coverage = Reading(metric="coverage", within=ALL, on=FILLED)
    columns = (SEQUENCE, Column(name="raw", unit="mm", places=1), Column(name="default", unit="mm", places=1),
               Column(name="ratio"), Column(name="default, measured", unit="mm", places=1),
               Column(name="ratio, measured"), Column(name="coverage raw", unit="%", places=1),
               Column(name="coverage default", unit="%"), N)  # fmt: skip
    ratios, of_measured = (
        {at.sequence: ratio(at.value(reading), at.value(reading, RAW)) for at in standings}
        for reading in (every, measured)
    )
    covered = {at.sequence: scaled(at.value(coverage), 100) for at in standings}
    rows = [
        (at.sequence, scaled(at.value(every, RAW), 1000), scaled(at.value(every), 1000), ratios[at.sequence],
         scaled(at.value(measured), 1000), of_measured[at.sequence], scaled(at.value(coverage, RAW), 100),
         covered[at.sequence], at.count(every))
        for at in standings
    ]  # fmt: skip
    title = "Flicker of static pixels within 20 m; measured: of those that the sensor measured in both frames; coverage"
    return Measured(
        table=Table.of(title, columns, with_mean(rows), "flicker"),
        findings=(
            average(Bar(what="Flicker of static pixels over raw's", bound=0.3), ratios),
            average(Bar(what="Flicker of static, measured pixels over raw's", bound=0.3), of_measured),
            worst(Bar(what="Coverage", bound=99.5, unit="%", at_least=True), covered),
        ),
    )


def of_movers(standings: Sequence[Standing]) -> Measured:
    """What becomes of things that move, and of what they uncover; of sequences that have some."""
    survival, survival_raw = (
        Reading(metric=name, mask=MOVING, within=ALL, on=AS_GIVEN) for name in ("survival", "survival_raw")
    )
    ghosts, ghosts_raw = (
        Reading(metric=name, mask=DEPARTED, within=ALL, on=FILLED) for name in ("ghosts", "ghosts_raw")
    )
    columns = (SEQUENCE, Column(name="survival raw", unit="%", places=1), Column(name="default", unit="%", places=1),
               Column(name="difference", unit="points", places=1), Column(name="n moving"),
               Column(name="ghosts raw", unit="%", places=1), Column(name="ghosts default", unit="%", places=1),
               Column(name="ghosts more", unit="points", places=1), Column(name="n departed"))  # fmt: skip
    movers = [at for at in standings if at.count(survival)]
    lost = {at.sequence: scaled(less(at.value(survival), at.value(survival_raw)), 100) for at in movers}
    added = {at.sequence: scaled(less(at.value(ghosts), at.value(ghosts_raw)), 100) for at in movers}
    rows = [
        (at.sequence, scaled(at.value(survival_raw), 100), scaled(at.value(survival), 100), lost[at.sequence],
         at.count(survival), scaled(at.value(ghosts_raw), 100), scaled(at.value(ghosts), 100), added[at.sequence],
         at.count(ghosts))
        for at in movers
    ]  # fmt: skip
    title = "Things that move: pixels within 5 % of the truth; ghosts of them 5 frames later"
    return Measured(
        table=Table.of(title, columns, with_mean(rows) if rows else [], "movers"),
        findings=(
            worst(Bar(what="Survival of what moves, less raw's", bound=-1, unit="points", at_least=True), lost),
            worst(Bar(what="Ghosts, less raw's", bound=1, unit="points"), added),
        ),
    )


def of_time(standings: Sequence[Standing]) -> Measured:
    """Time per frame beside the reference workload that was timed between the frames."""
    names = ("latency_p50", "latency_p95", "latency_max", "reference_workload_during", "latency_p50_workloads")
    columns = (SEQUENCE, Column(name="size"), Column(name="p50", unit="ms"), Column(name="p95", unit="ms"),
               Column(name="largest", unit="ms"), Column(name="workload", unit="ms"),
               Column(name="p50", unit="workloads"), N)  # fmt: skip
    p50, *others = (Reading(metric=name, mask=FRAMES, within=FRAMES, on=FRAMES) for name in names)
    rows: list[list[Value]] = [
        [at.sequence, at.facts.size, *(at.value(reading) for reading in (p50, *others)), at.count(p50)]
        for at in standings
    ]
    by_size: dict[str, Values] = {
        size: {at.sequence: at.value(p50) for at in standings if at.facts.size == size} for size in SIZES_MS
    }
    return Measured(
        table=Table.of("Time per frame of the default method, OpenCV on one thread", columns, rows, "time"),
        findings=[
            worst(Bar(what=f"Median time of a frame of {size}", bound=bound_ms, unit="ms"), by_size[size])
            for size, bound_ms in SIZES_MS.items()
        ],
    )
