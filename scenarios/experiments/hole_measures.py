"""What the default method is measured by in the sensor's holes, against peers and against the bound."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean

from voxdepth.registry import PAPER

from ..evaluation.methods import ORACLE
from .bars import Bar, Finding, average, worst
from .result import Column, Table
from .standing import HOLES, RAW, SMOOTHER, Reading, Standing, change_percent, ratio, scaled, with_mean

STILL = ("sim-hover",)
"""Sequences whose camera stays where it is, so that a memory saw nothing that the frame does not."""
FILLING = 0.9
"""Part of the pixels that a peer must fill for its share of wrong pixels to say something."""
SEQUENCE, N = Column(name="sequence"), Column(name="n")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """One measure: a row for each sequence, and what it says to the bars."""

    table: Table
    findings: Sequence[Finding] = ()


def of_holes(standings: Sequence[Standing]) -> Measured:
    """Mean error of what the sensor did not measure."""
    names = ("default", "its", "global-smoother", "true-pose", "paper", "raw")
    default, its, smoother, bound, paper, raw = (Column(name=name, unit="m", places=3) for name in names)
    columns = (SEQUENCE, default, Column(name="best peer but smoother"), its, smoother,
               Column(name="against best", unit="%", places=1), Column(name="against smoother", unit="%", places=1),
               bound, paper, raw, N)  # fmt: skip
    rows, to_best, to_smoother, to_any = [], {}, {}, {}
    for at in standings:
        own, best, overall = at.value(HOLES), at.best(HOLES, without=[SMOOTHER]), at.best(HOLES)
        of_smoother = at.value(HOLES, SMOOTHER)
        to_best[at.sequence] = change_percent(own, best.value)
        to_smoother[at.sequence] = change_percent(own, of_smoother)
        to_any[at.sequence] = change_percent(own, overall.value)
        others = (at.value(HOLES, name) for name in (ORACLE, PAPER, RAW))
        rows.append((at.sequence, own, best.name, best.value, of_smoother, to_best[at.sequence],
                     to_smoother[at.sequence], *others, at.count(HOLES)))  # fmt: skip
    still = {name: value for name, value in to_any.items() if name in STILL}
    moving = {name: value for name, value in to_any.items() if name not in STILL}
    what = "MAE in holes against"
    return Measured(
        table=Table.of("MAE in holes, surfaces within 20 m, after completion", columns, with_mean(rows), "holes"),
        findings=(
            average(Bar(what=f"{what} the best peer but the smoother", bound=-35, unit="%"), to_best),
            average(Bar(what=f"{what} the global smoother", bound=-20, unit="%"), to_smoother),
            worst(Bar(what=f"{what} the best of all peers, moving camera", bound=0, unit="%"), moving),
            worst(Bar(what=f"{what} the best of all peers, hover", bound=5, unit="%"), still),
        ),
    )


def of_seen_holes(standings: Sequence[Standing]) -> Measured:
    """How far the memory goes of the way that the true pose would go."""
    seen = Reading(metric="mae", mask="holes seen")
    columns = (SEQUENCE, Column(name="default", unit="m", places=3), Column(name="best peer"),
               Column(name="its", unit="m", places=3), Column(name="true-pose", unit="m", places=3),
               Column(name="way", unit="%", places=0), N)  # fmt: skip
    rows, ways, errors_m = [], {}, []
    for at in standings:
        own, best, bound = at.value(seen), at.best(seen), at.value(seen, ORACLE)
        way = ways[at.sequence] = way_percent(own, best.value, bound)
        rows.append((at.sequence, own, best.name, best.value, bound, way, at.count(seen)))
        if own is not None and best.value is not None and bound is not None:
            errors_m.append((own, best.value, bound))
    of_means = way_percent(*(mean(column) for column in zip(*errors_m, strict=True))) if errors_m else None
    what = "Holes seen before: way from the best peer to true-pose"
    bar, bar_each = (Bar(what=f"{what}{each}", bound=60, unit="%", at_least=True) for each in ("", ", each"))
    return Measured(
        table=Table.of("MAE in holes whose surface was measured rightly in the last 60 frames, within 20 m, completed",
                       columns, with_mean(rows), "holes-seen"),
        findings=(Finding(bar=bar, value=of_means, of=f"mean errors of {len(errors_m)}"), worst(bar_each, ways)),
    )  # fmt: skip


def way_percent(own: float | None, peer: float | None, bound: float | None) -> float | None:
    """Part of the way from a peer's error to a bound's [%]; more than 100 beyond it. None unless the bound is lower."""
    if own is None or peer is None or bound is None or bound >= peer:
        return None
    return 100 * (peer - own) / (peer - bound)


def of_wrong_pixels(standings: Sequence[Standing]) -> Measured:
    """Too far and too near together: a bias to one side wins either alone."""
    far, near, off = (Reading(metric=metric, mask="holes") for metric in ("too_far", "too_near", "off"))
    columns = (SEQUENCE, Column(name="too far", unit="%", places=1), Column(name="too near", unit="%", places=1),
               Column(name="off", unit="%", places=1), Column(name="best peer that fills"),
               Column(name="its off", unit="%", places=1), Column(name="ratio"), N)  # fmt: skip
    rows, ratios = [], {}
    for at in standings:
        best = at.best(off, covering=FILLING)
        ratios[at.sequence] = ratio(at.value(off), best.value)
        own = (scaled(at.value(reading), 100) for reading in (far, near, off))
        rows.append((at.sequence, *own, best.name, scaled(best.value, 100), ratios[at.sequence],
                     at.count(off)))  # fmt: skip
    bar = Bar(what="Holes more than 10 % off, over those of the best peer that fills 90 %", bound=0.7)
    title = "Holes more than 10 % too far or too near (off), within 20 m, after completion"
    return Measured(table=Table.of(title, columns, with_mean(rows), "off"), findings=(average(bar, ratios),))
