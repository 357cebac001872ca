"""The default method beside the baselines: the values of an evaluation by sequence, and the best baseline of each."""

from collections.abc import Sequence

import pandas as pd

from voxdepth.registry import DEFAULT

from ..evaluation.measurements import COMPLETED, FILLED, Selector
from ..evaluation.methods import DEFAULT_FILLED, is_baseline
from ..evaluation.suite import Evaluation

RAW, SMOOTHER = "raw", "global-smoother"
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
        found = self.by_method(selector)
        name = method or self.own(selector)
        return found[name] if name in found else pd.Series(float("nan"), self.sequences)

    def counts(self, selector: Selector) -> pd.Series:
        """The sample sizes of the default method by sequence; 0 where not measured."""
        return self.by_method(selector, "n")[self.own(selector)].fillna(0).astype(int)

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


def change_percent(values: pd.Series, bases: pd.Series) -> pd.Series:
    """Relative differences of values from bases [%]; NaN where the base is 0 or either is undefined."""
    return 100 * (values / bases.where(bases != 0) - 1)
