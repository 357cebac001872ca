"""The default method compared with the baselines: values by sequence, the best baseline, and acceptance criteria."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from statistics import mean

import pandas as pd

from voxdepth.registry import DEFAULT
from voxdepth.tools.table import Column, Table, Value

from ..evaluation.measurements import COMPLETED, FILLED, Selector
from ..evaluation.methods import DEFAULT_FILLED, is_baseline
from ..evaluation.suite import Evaluation

RAW, SMOOTHER = "raw", "global-smoother"
MEAN = "mean"
MET, UNKNOWN = "held", "not measured"

HOLES = Selector("mae", "holes")
COVERAGE = Selector("coverage", on=FILLED)


class Comparison:
    """The measurements of an evaluation by sequence and method."""

    def __init__(self, evaluation: Evaluation) -> None:
        self.evaluation = evaluation
        self.sequences = list(evaluation.sequences)
        self.baselines = [name for name in evaluation.methods if is_baseline(name)]
        """The methods that the default is compared with, in the order in which they ran."""

    def by_method(self, selector: Selector, column: str = "value") -> pd.DataFrame:
        """One quantity (`value`) or its sample size (`n`) by sequence and method (columns); NaN if undefined."""
        measured = self.evaluation.measurements.select(selector)[column].unstack("method")
        return measured.reindex(index=self.sequences, columns=self.evaluation.methods)

    def values(self, selector: Selector, method: str | None = None) -> pd.Series:
        """The values of a method, or of the default method as `own` says, by sequence; NaN where undefined."""
        return self.by_method(selector)[method or self.own(selector)]

    def counts(self, selector: Selector, method: str | None = None) -> pd.Series:
        """The sample sizes of `values` by sequence, as integers of Python; 0 where not measured."""
        return self.by_method(selector, "n")[method or self.own(selector)].fillna(0).astype(int).astype(object)

    def own(self, selector: Selector) -> str:
        """The name of the default method: after completion the one that completes its depth itself, if it took part."""
        return DEFAULT_FILLED if selector.on == COMPLETED and DEFAULT_FILLED in self.evaluation.methods else DEFAULT

    def best(self, selector: Selector, *, without: Sequence[str] = (), min_coverage: float = 0.0) -> pd.DataFrame:
        """The `name` and `value` of the baseline with the lowest value by sequence; None and NaN where none counts.

        Baselines in `without` do not count, nor those that fill less than `min_coverage` (0..1) of the pixels in 20 m.
        """
        fills = self.by_method(COVERAGE).fillna(0) >= min_coverage
        values = self.by_method(selector).where(fills)[[name for name in self.baselines if name not in without]]
        known = [row.dropna() for _, row in values.iterrows()]
        names = [None if row.empty else row.idxmin() for row in known]
        return pd.DataFrame({"name": names, "value": values.min(axis=1)}, self.sequences)


def ratio(values: pd.Series, bases: pd.Series) -> pd.Series:
    """Values over bases; NaN where the base is 0 or either is undefined."""
    return values / bases.where(bases != 0)


def change_percent(values: pd.Series, bases: pd.Series) -> pd.Series:
    """Relative differences of values from bases [%]; NaN where the base is 0 or either is undefined."""
    return 100 * (ratio(values, bases) - 1)


def comparison_table(title: str, name: str, columns: Mapping[Column, pd.Series]) -> Table:
    """A table with one row per sequence and a last row with the means; without any sequence it has no row."""
    sequences = list(next(iter(columns.values())).index)
    values = [[None if pd.isna(value) else value for value in series] for series in columns.values()]
    rows = [list(row) for row in zip(sequences, *values, strict=True)]
    if rows:
        rows.append([MEAN, *map(mean_of_known, values)])
    return Table.of(title, (Column("sequence"), *columns), rows, name=name)


def mean_of_known(values: Iterable[Value]) -> Value:
    """The mean of the floating-point numbers among values; None without any, as of counts, and empty for texts."""
    listed = list(values)
    if any(isinstance(value, str) for value in listed):
        return ""
    known = [value for value in listed if isinstance(value, float) and not math.isnan(value)]
    return sum(known) / len(known) if known else None


@dataclass(frozen=True)
class Criterion:
    """A bound on one number, and the number that it is applied to."""

    what: str
    bound: float
    unit: str = ""
    at_least: bool = False
    """Whether the bound is a lower bound."""
    value: float | None = None
    scope: str = ""
    """The sequences that the value is of."""

    @property
    def outcome(self) -> str:
        """`held`, `missed by` a distance, or `not measured`."""
        if self.value is None:
            return UNKNOWN
        missed = self.bound - self.value if self.at_least else self.value - self.bound
        if missed <= 0:
            return MET
        return f"missed by {missed:{'.2f' if missed >= 0.005 else '.1g'}} {self.unit}".rstrip()

    @property
    def row(self) -> tuple[str, ...]:
        """The row of the criterion in a table."""
        requirement = f"at {'least' if self.at_least else 'most'} {self.bound:g} {self.unit}".rstrip()
        measured = UNKNOWN if self.value is None else f"{self.value:.2f} {self.unit}".rstrip()
        return self.what, requirement, measured, self.scope, self.outcome


def worst(criterion: Criterion, values: pd.Series) -> Criterion:
    """Apply a criterion to the sequence with the worst value."""
    known = values.dropna()
    if known.empty:
        return replace(criterion, scope="no sequence")
    name = known.idxmin() if criterion.at_least else known.idxmax()
    return replace(criterion, value=float(known[name]), scope=f"{name}, worst of {len(known)}")


def average(criterion: Criterion, values: pd.Series) -> Criterion:
    """Apply a criterion to the mean over the sequences whose value is defined."""
    known = list(values.dropna())
    return replace(criterion, value=mean(known) if known else None, scope=f"mean of {len(known)}")


def criteria_table(criteria: Sequence[Criterion]) -> Table:
    """A table of all criteria with a count of their outcomes in the title."""
    outcomes = [criterion.outcome for criterion in criteria]
    met, unknown = outcomes.count(MET), outcomes.count(UNKNOWN)
    title = f"Criteria: {met} held, {len(outcomes) - met - unknown} missed, {unknown} not measured"
    columns = ("criterion", "requirement", "measured", "of", "outcome")
    return Table.of(title, columns, [criterion.row for criterion in criteria])
