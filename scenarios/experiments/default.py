"""The default method against all baselines on the same frames: its quality by sequence, and its acceptance criteria."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import pandas as pd

from voxdepth.registry import DEFAULT, PAPER, title
from voxdepth.tools.evaluation import scoring
from voxdepth.tools.evaluation.groups import ALL
from voxdepth.tools.evaluation.measurements import COMPLETED, FILLED, Selector, of_frames
from voxdepth.tools.evaluation.methods import DEFAULT_FILLED, METHOD_NAMES, ORACLE, is_baseline
from voxdepth.tools.evaluation.report import rendered
from voxdepth.tools.evaluation.suite import Evaluation
from voxdepth.tools.figure import panels, plotted
from voxdepth.types import Source

from ..sequences import GROUPS
from .experiment import ExperimentContext, Findings, asks

RAW, SMOOTHER = "raw", "global-smoother"
STATIONARY = ["sim-hover"]
"""Sequences with a stationary camera, so that a memory saw nothing that the frame does not show."""
SIZES_MS = {"640x360": 5.5, "1024x1024": 30.0}
"""Allowed median time of a frame by its size."""
MIN_PIXELS = 1000
"""Smallest bin of confidence that is compared with its neighbour."""
PANEL_SEQUENCES = 6
"""Sequences in a panel of the figure."""
HOLES, COVERAGE = Selector("mae", "holes"), Selector("coverage", on=FILLED)
SEEN, OFF = Selector("mae", "holes seen"), Selector("off", "holes")
RMSE, MEDIAN = (Selector(metric, "measured", on=FILLED) for metric in ("rmse", "median"))
PSNR_NEAR, PSNR_ALL = Selector("psnr_40m"), Selector("psnr_40m", range=ALL)
FLICKER, FLICKER_MEASURED = (Selector("flicker", mask, on=FILLED) for mask in (scoring.STATIC, scoring.STATIC_MEASURED))
LATENCY = of_frames("latency_p50")
PARTS = {
    "all": None,
    "holes": "holes",
    "memory": scoring.SOURCES[Source.MEMORY],
    "inpainted": scoring.SOURCES[Source.INPAINTED],
}
"""Masks of the pixels whose confidence is judged."""
NOT_MEASURED = "not measured"


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

    def values(self, selector: Selector, method: str | None = None, column: str = "value") -> pd.Series:
        """The values of a method, or of the default method as `own` says, by sequence; NaN where undefined."""
        return self.by_method(selector, column).reindex(columns=[method or self.own(selector)]).iloc[:, 0]

    def own(self, selector: Selector) -> str:
        """The name of the default method: after completion the one that completes its depth itself, if it took part."""
        return DEFAULT_FILLED if selector.on == COMPLETED and DEFAULT_FILLED in self.evaluation.methods else DEFAULT

    def best(self, selector: Selector, *, without: Sequence[str] = (), min_coverage: float = 0.0) -> pd.Series:
        """The lowest value of a baseline by sequence; NaN where none counts.

        Baselines in `without` do not count, nor those that fill less than `min_coverage` (0..1) of the pixels in 20 m.
        """
        fills = self.by_method(COVERAGE).fillna(0) >= min_coverage
        competing = [name for name in self.baselines if name not in without]
        return self.by_method(selector).where(fills)[competing].min(axis=1)


Values = Callable[[Comparison], pd.Series]
"""The number that a criterion judges, by sequence; NaN where undefined."""


@dataclass(frozen=True)
class Criterion:
    """A bound on the mean over all sequences, or on the value of each."""

    what: str
    bound: float
    unit: str
    values: Values
    at_least: bool = False
    """Whether the bound is a lower bound."""
    each: bool = False

    def row(self, comparison: Comparison) -> dict[str, str | float | None]:
        """The bound, the mean or worst value, and whether it is `held`, `missed` by a distance, or not measured."""
        known = self.values(comparison).dropna()
        requirement = f"{'each' if self.each else 'mean'} at {'least' if self.at_least else 'most'} {self.bound:g}"
        value, outcome = None, NOT_MEASURED
        if not known.empty:
            value = float((known.min() if self.at_least else known.max()) if self.each else known.mean())
            missed = self.bound - value if self.at_least else value - self.bound
            outcome = "held" if missed <= 0 else f"missed by {missed:.3g}"
        row = {"criterion": self.what, "unit": self.unit, "requirement": requirement}
        return row | {"measured": value, "outcome": outcome}


def change_percent(values: pd.Series, bases: pd.Series) -> pd.Series:
    """Relative differences of values from bases [%]; NaN where the base is 0 or either is undefined."""
    return 100 * (values / bases.where(bases != 0) - 1)


def against(method: str, selector: Selector) -> Values:
    """The change [%] from a method."""
    return lambda c: change_percent(c.values(selector), c.values(selector, method))


def against_best(selector: Selector, **which: Any) -> Values:
    """The change [%] from the best baseline of each sequence, see `Comparison.best`."""
    return lambda c: change_percent(c.values(selector), c.best(selector, **which))


def above(method: str, selector: Selector) -> Values:
    """The difference from a method."""
    return lambda c: c.values(selector) - c.values(selector, method)


def more_than_raw(selectors: Sequence[Selector]) -> Values:
    """The difference of a share from that of raw depth, which is a measurement of its own [points]."""
    return lambda c: 100 * (c.values(selectors[0]) - c.values(selectors[1]))


def where_moving(values: Values) -> Values:
    """The values of the sequences with a moving camera."""
    return lambda c: values(c).drop(STATIONARY, errors="ignore")


def where_hovering(values: Values) -> Values:
    """The values of the sequences with a stationary camera."""
    return lambda c: values(c).reindex(STATIONARY)


def time_of(size: str) -> Values:
    """The median time of the sequences of a size [ms]."""
    return lambda c: c.values(LATENCY)[[c.evaluation.sequences[name].size == size for name in c.sequences]]


def gap_closed_percent(comparison: Comparison) -> pd.Series:
    """Share of the gap between the errors of the best baseline and of the oracle that the default closes [%].

    It is 0 at the error of the baseline and 100 at that of the oracle; NaN if the oracle is not better.
    """
    best, oracle = comparison.best(SEEN), comparison.values(SEEN, ORACLE)
    gap = best - oracle
    return 100 * (best - comparison.values(SEEN)) / gap.where(gap > 0)


def largest_fall(mask: str | None) -> Values:
    """The largest fall of the share of correct pixels from a bin of confidence to the next [points]; below 0 for none.

    It is over all sequences, of the pixels of a mask or of all, and NaN with less than two large enough bins.
    """
    masks = [name if mask is None else scoring.in_bin(mask, name) for name in scoring.CONFIDENCES]
    selectors = [Selector("correct", name, scoring.CALIBRATION_RANGE, FILLED) for name in masks]

    def fall(comparison: Comparison) -> pd.Series:
        n, shares = (pd.DataFrame([comparison.values(s, None, of) for s in selectors]) for of in ("n", "value"))
        pooled = (shares * n).sum(axis=1) / n.sum(axis=1)
        return pd.Series([-100 * pooled[n.sum(axis=1) >= MIN_PIXELS].diff().min()])

    return fall


CRITERIA = (
    Criterion("MAE in holes against the best baseline but the smoother", -35, "%",
              against_best(HOLES, without=[SMOOTHER])),
    Criterion("MAE in holes against the global smoother", -20, "%", against(SMOOTHER, HOLES)),
    Criterion("MAE in holes against the best baseline, moving camera", 0, "%", where_moving(against_best(HOLES)),
              each=True),
    Criterion("MAE in holes against the best baseline, hover", 5, "%", where_hovering(against_best(HOLES)), each=True),
    Criterion("Holes seen before: closed share of the gap from the best baseline to true-pose", 60, "%",
              gap_closed_percent, at_least=True, each=True),
    Criterion("Holes more than 10 % off against the best baseline that fills 90 %", -30, "%",
              against_best(OFF, min_coverage=0.9)),
    Criterion("RMSE of measured pixels against raw", 0, "%", against(RAW, RMSE), each=True),
    Criterion("RMSE of measured pixels against raw", -20, "%", against(RAW, RMSE)),
    Criterion("Median error of measured pixels against raw", 0, "%", against(RAW, MEDIAN), each=True),
    Criterion("Median error of measured pixels against raw", -35, "%", against(RAW, MEDIAN)),
    Criterion("PSNR within 20 m above voxdepth's", 3, "dB", above(PAPER, PSNR_NEAR), at_least=True, each=True),
    Criterion("PSNR within 20 m above voxdepth's", 6, "dB", above(PAPER, PSNR_NEAR), at_least=True),
    Criterion("PSNR of all surfaces above voxdepth's", 3, "dB", above(PAPER, PSNR_ALL), at_least=True, each=True),
    Criterion("PSNR of all surfaces above voxdepth's", 6, "dB", above(PAPER, PSNR_ALL), at_least=True),
    Criterion("Flicker of static pixels against raw", -70, "%", against(RAW, FLICKER)),
    Criterion("Flicker of static, measured pixels against raw", -70, "%", against(RAW, FLICKER_MEASURED)),
    Criterion("Survival of what moves, less raw's", -1, "points", more_than_raw(scoring.SURVIVAL),
              at_least=True, each=True),
    Criterion("Ghosts, less raw's", 1, "points", more_than_raw(scoring.GHOSTS), each=True),
    Criterion("Sky shown within 20 m", 1, "%", lambda c: 100 * c.values(scoring.SKY_NEAR), each=True),
    Criterion("Phantom obstacles, hover", 0, "", where_hovering(lambda c: c.values(scoring.PHANTOMS)), each=True),
    *(Criterion(f"Median time of a frame of {size}", ms, "ms", time_of(size), each=True)
      for size, ms in SIZES_MS.items()),
    *(Criterion(f"Largest fall of the share of correct pixels where confidence rises, {name}", 0, "points",
                largest_fall(mask), each=True) for name, mask in PARTS.items()),
)  # fmt: skip


@asks(
    "Is the default method better than every baseline, and does it meet its acceptance criteria?",
    sequences=(*GROUPS["reference"], *GROUPS["hard"]), frames=40, min_frames=2,
)  # fmt: skip
def default(context: ExperimentContext) -> Findings:
    """Evaluate all methods and apply every criterion to the default method."""
    comparison = Comparison(context.evaluate(METHOD_NAMES))
    starts = range(0, len(comparison.sequences), PANEL_SEQUENCES)
    parts = [comparison.sequences[start : start + PANEL_SEQUENCES] for start in starts]
    errors_m = {comparison.own(HOLES): comparison.values(HOLES), "best baseline": comparison.best(HOLES)}
    errors_m |= {name: comparison.values(HOLES, name) for name in (SMOOTHER, ORACLE, PAPER, RAW)}
    frame, label = pd.DataFrame(errors_m).rename(columns=title), f"best baseline of each sequence; {ORACLE} is a bound"
    return Findings(
        tables={"table": pd.DataFrame([criterion.row(comparison) for criterion in CRITERIA])},
        notes=(
            "Baselines are all methods but voxdepth, temporal and true-pose, an oracle; the best one is chosen for "
            "each sequence and each quantity. Errors after completion are those of `temporal[fill=all]`. Every "
            "sequence has the same weight. All quantities of all methods are in report.html.",
            "The default method was tuned on seed 101, with a look at 102 and 103, so results of these prove nothing.",
        ),
        figure=panels(
            f"MAE in holes within 20 m, after completion, n = {context.frames} frames of each sequence",
            [plotted(frame.loc[part], label, "sequence", "MAE in holes [m]", kind="bar", rot=0) for part in parts],
        ),
        files={"report.html": rendered(comparison.evaluation).encode()},
    )
