"""What each table of the report and of the terminal shows: which measurements, in which unit, and how they rank."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from math import isnan
from typing import Literal

import pandas as pd

from ..results.table import MISSING
from .groups import ALL, BINS, HELD_OUT_GROUPS, NEAR, TRUE_GROUPS
from .measurements import AS_GIVEN, COMPLETED, FILLED, FRAMES, Selector
from .scoring import CALIBRATION_RANGE, DEPARTED, MOVING, SOURCES
from .suite import Evaluation

HIDDEN = "hidden"
"""Stands for the mask of the pixels that methods are given no depth of: holes, or pixels that were held out."""
HIDDEN_MASKS = (TRUE_GROUPS.hidden, HELD_OUT_GROUPS.hidden)


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """What one table shows of every result: one number, or some that only together say something."""

    title: str
    unit: str
    metrics: Sequence[str]
    masks: Sequence[str] = ("all",)
    ranges: Sequence[str] = (NEAR,)
    on: str = COMPLETED
    note: str = ""
    best: Literal["low", "high", ""] = ""
    """Whether the lowest or the highest first number is marked; empty for none."""
    show: Callable[[float], str] = "{:.3f}".format
    against_raw: bool = False
    """Whether the second number is that of raw depth, and is shown with the difference of the first one [%]."""

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return f"{self.title} [{self.unit}]"

    @property
    def selectors(self) -> list[Selector]:
        """The numbers in their order."""
        return [Selector(*parts, self.on) for parts in product(self.metrics, self.masks, self.ranges)]

    def text(self, values: Sequence[float]) -> str:
        """Write numbers as people read them; NaN is missing."""
        if all(isnan(value) for value in values):
            return MISSING
        if self.against_raw:
            own, raw = values
            return MISSING if isnan(own) or isnan(raw) else f"{self.show(raw)} {100 * (own - raw):+.1f}"
        return " / ".join(MISSING if isnan(value) else self.show(value) for value in values)


def select(evaluation: Evaluation, quantity: Quantity) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return values and sample sizes, one column per selector, by sequence and method.

    Both are empty if nothing was measured.
    """
    parts = [_select(evaluation, selector) for selector in quantity.selectors]
    values, counts = (pd.concat([part[name] for part in parts], axis=1, keys=range(len(parts))) for name in parts[0])
    return values, counts


def is_measured(evaluation: Evaluation, quantity: Quantity) -> bool:
    """Whether any result has a number of a quantity, since not all sequences and methods have all."""
    return any(len(_select(evaluation, selector)) for selector in quantity.selectors)


def _select(evaluation: Evaluation, selector: Selector) -> pd.DataFrame:
    """Select measurements, but without the truth no errors of all pixels: methods were given most of these."""
    masks = HIDDEN_MASKS if selector.mask == HIDDEN else (selector.mask,)
    found = pd.concat([evaluation.measurements.select(selector._replace(mask=mask)) for mask in masks])
    if selector.mask == "all" and selector.metric != "coverage":
        true = [info.name for info in evaluation.sequences.values() if info.is_true]
        return found[found.index.isin(true, level="sequence")]
    return found


def percent(share: float) -> str:
    """Write a share in percent."""
    return f"{100 * share:.1f}"


def millimetres(value_m: float) -> str:
    """Write metres in millimetres."""
    return f"{1000 * value_m:.1f}"


def whole_millimetres(value_m: float) -> str:
    """Write metres in millimetres, rounded to whole ones."""
    return f"{1000 * value_m:.0f}"


two_places = "{:.2f}".format

PAPER_LAYOUT = (
    Quantity(
        title="PSNR, peak 65535 mm, surfaces within that, after completion",
        unit="dB",
        metrics=["psnr16_mm"],
        ranges=[ALL],
        note="Higher is better.",
        best="high",
        show=two_places,
    ),
    Quantity(
        title="Masked RMSE, occluded pixels within 20 m, after completion",
        unit="m",
        metrics=["rmse"],
        masks=["occluded"],
        note="Lower is better. The paper's masked RMSE has no unit, and is below, beside what repeats its arithmetic.",
        best="low",
    ),
    Quantity(
        title="Masked MAE, occluded pixels within 20 m, after completion",
        unit="m",
        metrics=["mae"],
        masks=["occluded"],
        note="Lower is better.",
        best="low",
    ),
)
"""Tables in the layout of the paper's."""
PAPER_ARITHMETIC = (
    Quantity(
        title="m_rmse_u16_wrap, occluded pixels",
        unit="no unit",
        metrics=["m_rmse_u16_wrap"],
        masks=["occluded"],
        ranges=[ALL],
        on=AS_GIVEN,
        note="The authors' arithmetic, which subtracts and squares in 16 bits. Unrelated images score 179.96, an error "
        "of 256 mm everywhere scores 0: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
    Quantity(
        title="psnr_minmax8",
        unit="dB",
        metrics=["psnr_minmax8"],
        ranges=[ALL],
        on=AS_GIVEN,
        note="The authors' arithmetic, which stretches each image by its own extremes to 8 bits. A copy scaled by 2 "
        "scores 361 dB: it ranks nothing. Mean over frames.",
        show=two_places,
    ),
)
"""Tables in the layout of the paper's that repeat its arithmetic, for comparison only."""
QUANTITIES = (
    Quantity(
        title="Coverage: pixels with depth, surfaces within 20 m",
        unit="%",
        metrics=["coverage"],
        on=FILLED,
        show=percent,
        note="Errors of methods that fill less than 90 % say little beside those of others.",
    ),
    Quantity(
        title="MAE of the pixels that a method fills, surfaces within 20 m",
        unit="m",
        metrics=["mae"],
        on=FILLED,
        note="Not comparable where coverages differ: a method that leaves the hard pixels out errs less.",
    ),
    Quantity(
        title="MAE of all pixels within 20 m, after completion by the nearest valid",
        unit="m",
        metrics=["mae"],
        best="low",
    ),
    Quantity(title="RMSE of all pixels within 20 m, after completion", unit="m", metrics=["rmse"], best="low"),
    Quantity(
        title="Median error of all pixels within 20 m, after completion",
        unit="mm",
        metrics=["median"],
        best="low",
        show=millimetres,
    ),
    Quantity(
        title="RMSE of inverse depth, all surfaces, after completion",
        unit="1/m",
        metrics=["inverse_rmse"],
        ranges=[ALL],
        best="low",
        show="{:.4f}".format,
    ),
    Quantity(
        title="MAE in the sensor's holes (held-out pixels where there is no truth), within 20 m, after completion",
        unit="m",
        metrics=["mae"],
        masks=[HIDDEN],
        best="low",
    ),
    Quantity(
        title="MAE in holes whose surface was measured correctly in the last 60 frames, within 20 m, completed",
        unit="m",
        metrics=["mae"],
        masks=["holes seen"],
        best="low",
        note="A memory could know these.",
    ),
    Quantity(
        title="MAE in holes never seen, within 20 m, after completion",
        unit="m",
        metrics=["mae"],
        masks=["holes never seen"],
        best="low",
        note="These can only be guessed.",
    ),
    Quantity(
        title="Median error of measured pixels within 20 m",
        unit="mm",
        metrics=["median"],
        masks=["measured"],
        on=FILLED,
        best="low",
        show=millimetres,
    ),
    Quantity(
        title="RMSE of measured pixels within 20 m",
        unit="m",
        metrics=["rmse"],
        masks=["measured"],
        on=FILLED,
        best="low",
    ),
    Quantity(
        title="More than 10 % too far / too near in those holes (held-out pixels), within 20 m, after completion",
        unit="%",
        metrics=["too_far", "too_near"],
        masks=[HIDDEN],
        show=percent,
        note="Together, because a bias to one side wins either alone.",
    ),
    Quantity(
        title="Flicker: mean change of the error of static pixels within 20 m from frame to frame",
        unit="mm",
        metrics=["flicker"],
        masks=["static"],
        on=FILLED,
        show=millimetres,
        note="Without the truth it is the change of the depth, where the gray image hardly changes.",
    ),
    Quantity(
        title=f"Flicker by range, {' / '.join(BINS)}",
        unit="mm",
        metrics=["flicker"],
        masks=["static"],
        ranges=BINS,
        on=FILLED,
        show=whole_millimetres,
    ),
    Quantity(
        title="Static pixels within 20 m that gain or lose their depth from frame to frame",
        unit="%",
        metrics=["switched"],
        masks=["static"],
        on=FILLED,
        show=percent,
    ),
    Quantity(
        title="Survival: pixels of moving objects within 5 % of the truth, of raw depth, and the method's difference",
        unit="%",
        metrics=["survival", "survival_raw"],
        masks=[MOVING],
        ranges=[ALL],
        on=AS_GIVEN,
        best="high",
        show=percent,
        against_raw=True,
        note="A hole does not survive. Only sequences with known moving objects have it.",
    ),
    Quantity(
        title="Ghosts: filled pixels nearer to the object that left 5 frames ago than to the background, of raw depth, "
        "and the method's difference",
        unit="%",
        metrics=["ghosts", "ghosts_raw"],
        masks=[DEPARTED],
        ranges=[ALL],
        on=FILLED,
        best="low",
        show=percent,
        against_raw=True,
        note="Nearer by the geometric mean. A method that leaves such pixels empty has no ghosts: see the sample "
        "sizes.",
    ),
    Quantity(
        title=f"MAE by the source that a method names for a pixel: sensor / memory / inpainted, {CALIBRATION_RANGE}",
        unit="m",
        metrics=["mae"],
        masks=list(SOURCES.values()),
        ranges=[CALIBRATION_RANGE],
        on=FILLED,
        show=two_places,
        note="The number of pixels of each source is in results.csv.",
    ),
    Quantity(
        title="Time per frame, median / 95th percentile / in threads of its own beside that",
        unit="ms",
        metrics=["latency_p50", "latency_p95", "latency_background"],
        masks=[FRAMES],
        ranges=[FRAMES],
        on=FRAMES,
        show="{:.1f}".format,
        note="OpenCV on one thread, one method at a time, after a warm-up. The third number is the "
        "mean CPU time of a method's own threads: 'paper' fuses its window in one.",
    ),
    Quantity(
        title="Median time per frame in reference workloads / reference workload before / between frames / after",
        unit="ms",
        metrics=["latency_p50_workloads", *(f"reference_workload_{when}" for when in ("before", "during", "after"))],
        masks=[FRAMES],
        ranges=[FRAMES],
        on=FRAMES,
        show=two_places,
        note="The reference workload is a 5x5 median of 640x360 pixels, timed in the same process right before each "
        "method's run, after each of its frames, and right after it. Where it differs from that of other runs, "
        "something else took time from the machine.",
    ),
)
"""Tables of the report: a quantity of all methods on all sequences, with the best marked and the sample sizes."""

TERMINAL_COLUMNS = (
    Quantity(title="filled", unit="%", metrics=["coverage"], on=FILLED, show=percent),
    Quantity(title="MAE filled", unit="m", metrics=["mae"], on=FILLED, show=two_places),
    Quantity(title="MAE all", unit="m", metrics=["mae"], show=two_places),
    Quantity(title="MAE holes", unit="m", metrics=["mae"], masks=[HIDDEN], show=two_places),
    Quantity(
        title="far/near",
        unit="%",
        metrics=["too_far", "too_near"],
        masks=[HIDDEN],
        show=lambda share: f"{100 * share:.0f}",
    ),
    Quantity(title="flicker", unit="mm", metrics=["flicker"], masks=["static"], on=FILLED, show=whole_millimetres),
    Quantity(
        title="p50/p95",
        unit="ms",
        metrics=["latency_p50", "latency_p95"],
        masks=[FRAMES],
        ranges=[FRAMES],
        on=FRAMES,
        show="{:.0f}".format,
    ),
)
"""Columns of the table that the terminal shows of a sequence."""
MOVING_COLUMNS = (
    Quantity(
        title="survival raw, difference",
        unit="%",
        metrics=["survival", "survival_raw"],
        masks=[MOVING],
        ranges=[ALL],
        on=AS_GIVEN,
        show=percent,
        against_raw=True,
    ),
    Quantity(
        title="ghosts raw, difference",
        unit="%",
        metrics=["ghosts", "ghosts_raw"],
        masks=[DEPARTED],
        ranges=[ALL],
        on=FILLED,
        show=percent,
        against_raw=True,
    ),
)
"""Columns of sequences with moving objects."""
