"""The long table of an evaluation: one row per number, with queries by metric, mask, range and pixels."""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import pandas as pd

from .frames import NEAR

FILLED, COMPLETED, AS_GIVEN = "filled", "completed", "as given"
"""Values of `Measurement.on`."""
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


class Measurement(NamedTuple):
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


class Measurements:
    """The long table of `MEASUREMENT_COLUMNS`, with at most one row per sequence, method and `Selector`."""

    def __init__(self, rows: Iterable[tuple[Any, ...]]) -> None:
        self.frame = pd.DataFrame(list(rows), columns=list(MEASUREMENT_COLUMNS)).astype(COLUMN_TYPES)
        """The rows in their order; an undefined value is NaN."""
        indexed = self.frame.set_index([*Selector._fields, "sequence", "method"])[["value", "n"]]
        self._indexed = indexed.sort_index()

    def select(self, selector: Selector) -> pd.DataFrame:
        """Return the columns `value` and `n` by sequence and method; the frame has no row if nothing was measured."""
        try:
            return self._indexed.loc[tuple(selector)]
        except KeyError:
            return self._indexed.iloc[:0].droplevel(list(Selector._fields))

    def table(self, columns: Mapping[str, Selector]) -> pd.DataFrame:
        """Return a column of values for each selector by its heading, by sequence and method; NaN where undefined."""
        values = {heading: self.select(selector)["value"] for heading, selector in columns.items()}
        return pd.DataFrame(values, pd.MultiIndex.from_frame(self.frame[["sequence", "method"]].drop_duplicates()))

    def value(self, sequence: str, method: str, selector: Selector) -> float | None:
        """Return one value, or None if it was not measured or is undefined."""
        value = self.select(selector)["value"].get((sequence, method))
        return None if pd.isna(value) else float(value)
