"""What the confidence and the sources of the default method are worth: pixels of all sequences together."""

from collections.abc import Sequence
from itertools import pairwise

from ..evaluation.measurements import FILLED
from ..evaluation.scoring import CALIBRATION_RANGE as WITHIN
from ..evaluation.scoring import CONFIDENCES, SOURCES
from .bars import Bar, Finding
from .hole_measures import Measured
from .result import Column, Table
from .standing import Reading, Standing

LEAST_PIXELS = 1000
"""A bin with fewer says too little to be held against the confidence."""


def of_trust(standings: Sequence[Standing]) -> list[Measured]:
    """Errors by confidence and by source."""
    return [_by_confidence(standings), _by_source(standings)]


def pooled(standings: Sequence[Standing], metric: str, mask: str) -> tuple[float | None, int]:
    """The mean of a figure over the pixels of all sequences, and how many these are."""
    reading = Reading(metric=metric, mask=mask, within=WITHIN, on=FILLED)
    parts = [(at.value(reading), at.count(reading)) for at in standings]
    n = sum(count for _, count in parts)
    total = sum(value * count for value, count in parts if value is not None)
    return (total / n if n else None), n


def largest_fall(shares: Sequence[tuple[float | None, int]]) -> float | None:
    """By how much the share of right pixels falls at most from one bin to the next surer one [points]; below 0 if it
    rises everywhere. None with less than two bins of enough pixels.

    Args:
        shares: Of right pixels, 0..1, and how many pixels, by rising confidence.
    """
    known = [share for share, n in shares if share is not None and n >= LEAST_PIXELS]
    falls = [100 * (lower - higher) for lower, higher in pairwise(known)]
    return max(falls) if falls else None


def _by_confidence(standings: Sequence[Standing]) -> Measured:
    shares = [pooled(standings, "right", mask) for mask in CONFIDENCES]
    bar = Bar(what="Largest fall of the share of right pixels where confidence rises", bound=0, unit="points")
    finding = Finding(bar=bar, value=largest_fall(shares), of=f"bins of {LEAST_PIXELS} pixels and more")
    title = f"Pixels by confidence, and how many are right (5 % or 0.25 px), {WITHIN}, all sequences"
    return Measured(table=_table(standings, CONFIDENCES, title, "confidence"), findings=(finding,))


def _by_source(standings: Sequence[Standing]) -> Measured:
    title = f"Pixels by where the depth is from, and how many are right, {WITHIN}, all sequences"
    return Measured(table=_table(standings, list(SOURCES.values()), title, "source"))


def _table(standings: Sequence[Standing], masks: Sequence[str], title: str, name: str) -> Table:
    columns = (Column(name=name), Column(name="right", unit="%", places=1),
               Column(name="MAE", unit="m", places=3), Column(name="pixels", unit="%"), Column(name="n"))  # fmt: skip
    counts = [pooled(standings, "right", mask)[1] for mask in masks]
    rows = []
    for mask, n in zip(masks, counts, strict=True):
        share = pooled(standings, "right", mask)[0]
        part = 100 * n / sum(counts) if n else 0.0
        right = None if share is None else 100 * share
        rows.append((mask.removeprefix(f"{name} "), right, pooled(standings, "mae", mask)[0], part, n))
    return Table.of(title, columns, rows, name)
