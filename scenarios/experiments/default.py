"""The default method against all baselines on the same frames: its quality by sequence, and its acceptance criteria."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

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


@dataclass(frozen=True)
class Bound:
    """A bound on the mean over all sequences, or on the value of each."""

    value: float
    at_least: bool = False
    """Whether it is a lower bound."""
    each: bool = False

    def row(self, what: str, unit: str, values: pd.Series) -> dict[str, str | float | None]:
        """The bound, the mean or worst value, and whether it is `held`, `missed` by a distance, or not measured."""
        known = values.dropna()
        requirement = f"{'each' if self.each else 'mean'} at {'least' if self.at_least else 'most'} {self.value:g}"
        value, outcome = None, NOT_MEASURED
        if not known.empty:
            value = float((known.min() if self.at_least else known.max()) if self.each else known.mean())
            missed = self.value - value if self.at_least else value - self.value
            outcome = "held" if missed <= 0 else f"missed by {missed:.3g}"
        row = {"criterion": what, "unit": unit, "requirement": requirement}
        return row | {"measured": value, "outcome": outcome}


MEAN_AT_MOST, MEAN_AT_LEAST = Bound, partial(Bound, at_least=True)
EACH_AT_MOST, EACH_AT_LEAST = partial(Bound, each=True), partial(Bound, at_least=True, each=True)


def criteria(c: Comparison) -> list[dict[str, str | float | None]]:
    """Judge the default method by all criteria: a row for each quantity and bound, see `Bound.row`."""

    def against(method: str, selector: Selector) -> pd.Series:
        return change_percent(c.values(selector), c.values(selector, method))

    def above(method: str, selector: Selector) -> pd.Series:
        return c.values(selector) - c.values(selector, method)

    holes = change_percent(c.values(HOLES), c.best(HOLES))
    but_smoother = change_percent(c.values(HOLES), c.best(HOLES, without=[SMOOTHER]))
    off = change_percent(c.values(OFF), c.best(OFF, min_coverage=0.9))
    survival, ghosts = (100 * (c.values(own) - c.values(raw)) for own, raw in (scoring.SURVIVAL, scoring.GHOSTS))
    sizes = pd.Series({name: info.size for name, info in c.evaluation.sequences.items()}, dtype=str)
    quantities: list[tuple[str, str, pd.Series, list[Bound]]] = [
        ("MAE in holes against the best baseline but the smoother", "%", but_smoother, [MEAN_AT_MOST(-35)]),
        ("MAE in holes against the global smoother", "%", against(SMOOTHER, HOLES), [MEAN_AT_MOST(-20)]),
        ("MAE in holes against the best baseline, moving camera", "%", holes.drop(STATIONARY, errors="ignore"),
         [EACH_AT_MOST(0)]),
        ("MAE in holes against the best baseline, hover", "%", holes.reindex(STATIONARY), [EACH_AT_MOST(5)]),
        ("Holes seen before: closed share of the gap from the best baseline to true-pose", "%", gap_closed_percent(c),
         [EACH_AT_LEAST(60)]),
        ("Holes more than 10 % off against the best baseline that fills 90 %", "%", off, [MEAN_AT_MOST(-30)]),
        ("RMSE of measured pixels against raw", "%", against(RAW, RMSE), [EACH_AT_MOST(0), MEAN_AT_MOST(-20)]),
        ("Median error of measured pixels against raw", "%", against(RAW, MEDIAN),
         [EACH_AT_MOST(0), MEAN_AT_MOST(-35)]),
        ("PSNR within 20 m above voxdepth's", "dB", above(PAPER, PSNR_NEAR), [EACH_AT_LEAST(3), MEAN_AT_LEAST(6)]),
        ("PSNR of all surfaces above voxdepth's", "dB", above(PAPER, PSNR_ALL), [EACH_AT_LEAST(3), MEAN_AT_LEAST(6)]),
        ("Flicker of static pixels against raw", "%", against(RAW, FLICKER), [MEAN_AT_MOST(-70)]),
        ("Flicker of static, measured pixels against raw", "%", against(RAW, FLICKER_MEASURED), [MEAN_AT_MOST(-70)]),
        ("Survival of what moves, less raw's", "points", survival, [EACH_AT_LEAST(-1)]),
        ("Ghosts, less raw's", "points", ghosts, [EACH_AT_MOST(1)]),
        ("Sky shown within 20 m", "%", 100 * c.values(scoring.SKY_NEAR), [EACH_AT_MOST(1)]),
        ("Phantom obstacles, hover", "", c.values(scoring.PHANTOMS).reindex(STATIONARY), [EACH_AT_MOST(0)]),
        *((f"Median time of a frame of {size}", "ms", c.values(LATENCY)[sizes == size], [EACH_AT_MOST(limit_ms)])
          for size, limit_ms in SIZES_MS.items()),
        *((f"Largest fall of the share of correct pixels where confidence rises, {name}", "points",
           largest_fall(c, mask), [EACH_AT_MOST(0)]) for name, mask in PARTS.items()),
    ]  # fmt: skip
    return [bound.row(what, unit, values) for what, unit, values, bounds in quantities for bound in bounds]


def change_percent(values: pd.Series, bases: pd.Series) -> pd.Series:
    """Relative differences of values from bases [%]; NaN where the base is 0 or either is undefined."""
    return 100 * (values / bases.where(bases != 0) - 1)


def gap_closed_percent(comparison: Comparison) -> pd.Series:
    """Share of the gap between the errors of the best baseline and of the oracle that the default closes [%].

    It is 0 at the error of the baseline and 100 at that of the oracle; NaN if the oracle is not better.
    """
    best, oracle = comparison.best(SEEN), comparison.values(SEEN, ORACLE)
    gap = best - oracle
    return 100 * (best - comparison.values(SEEN)) / gap.where(gap > 0)


def largest_fall(comparison: Comparison, mask: str | None) -> pd.Series:
    """The largest fall of the share of correct pixels from a bin of confidence to the next [points]; below 0 for none.

    It is over all sequences, of the pixels of a mask or of all, and NaN with less than two large enough bins.
    """
    masks = [name if mask is None else scoring.in_bin(mask, name) for name in scoring.CONFIDENCES]
    selectors = [Selector("correct", name, scoring.CALIBRATION_RANGE, FILLED) for name in masks]
    n, shares = (pd.DataFrame([comparison.values(s, None, of) for s in selectors]) for of in ("n", "value"))
    pooled = (shares * n).sum(axis=1) / n.sum(axis=1)
    return pd.Series([-100 * pooled[n.sum(axis=1) >= MIN_PIXELS].diff().min()])


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
        tables={"table": pd.DataFrame(criteria(comparison))},
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
