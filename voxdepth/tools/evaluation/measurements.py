"""The long table of an evaluation: one row per number, which is selected by metric, mask, range and pixels."""

from collections.abc import Iterable
from typing import Any, NamedTuple

import pandas as pd

from .frames import NEAR

FILLED, COMPLETED, AS_GIVEN = "filled", "completed", "as given"
"""Values of `MetricValue.on`."""
FRAMES = "frames"
"""Mask, range and `on` of a measurement of whole frames, such as a latency."""
MEASUREMENT_COLUMNS = ("sequence", "method", "metric", "mask", "range", "on", "value", "unit", "n", "error")
"""Columns of the long table; `error` says why a method has no figures, and is empty otherwise."""
COLUMN_TYPES = dict.fromkeys(MEASUREMENT_COLUMNS, "str") | {"value": "float64", "n": "int64"}


class Selector(NamedTuple):
    """Selects one quantity of the long table, for all methods on all sequences."""

    metric: str
    mask: str = "all"
    range: str = NEAR
    on: str = COMPLETED


def of_frames(metric: str) -> Selector:
    """Select a metric of whole frames."""
    return Selector(metric, FRAMES, FRAMES, FRAMES)


class MetricValue(NamedTuple):
    """One number with its unit and its sample size."""

    metric: str
    mask: str
    """Which pixels the number is of."""
    range: str
    """Range of the reference depth of these pixels."""
    on: str
    """`filled` pixels have a depth; `completed` means all pixels after completion by the nearest valid one, and
    `as given` all pixels, those without depth included."""
    value: float | None
    """None if it is undefined, such as an error of no pixel; infinite for the PSNR of a perfect image."""
    unit: str
    n: int
    """Number of pixels or frames."""


def long_table(rows: Iterable[tuple[Any, ...]]) -> pd.DataFrame:
    """Return rows of `MEASUREMENT_COLUMNS` in their order as a frame; an undefined value is NaN."""
    return pd.DataFrame(list(rows), columns=list(MEASUREMENT_COLUMNS)).astype(COLUMN_TYPES)


def select(table: pd.DataFrame, selector: Selector) -> pd.DataFrame:
    """Return the columns `value` and `n` of a long table by sequence and method; no row if nothing was measured."""
    chosen = (table[list(Selector._fields)] == selector).all(axis="columns")
    return table[chosen].set_index(["sequence", "method"])[["value", "n"]]
