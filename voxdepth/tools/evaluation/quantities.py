"""What the report and the terminal show: which measurements, in which unit, and how they rank."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import isnan
from typing import Literal

import pandas as pd

from ...metrics import BELIEVED
from ..results.table import MISSING
from .frames import ALL, HOLES, MEASURED
from .measurements import FILLED, Selector, of_frames, select
from .recordings import HELD_OUT
from .reliability import BELIEVED_SHARES, CALIBRATION_ERROR, OVERALL
from .scoring import FLYING, GHOSTS, STATIC, SURVIVAL
from .suite import Evaluation

HIDDEN = "hidden"
"""Stands for the mask of the pixels that methods are given no depth of: holes, or pixels that were held out."""
HIDDEN_MASKS = (HOLES, *HELD_OUT)
MILLIMETRES_BELOW_M = 0.1
"""Lengths with a smaller median are shown in millimetres, as at a desk, and others in metres, as in a street."""
UNITS = {"%": (100, 1), "mm": (1000, 1), "m": (1, 3), "ms": (1, 1)}
"""Factor from the unit of the measurements, and decimal places, by the unit of a quantity."""


@dataclass(frozen=True)
class Quantity:
    """What one table shows of every result: one number, or some that only together say something."""

    title: str
    unit: str
    selectors: Sequence[Selector]
    note: str = ""
    best: Literal["low", "high", ""] = ""
    """Whether the lowest or the highest first number is marked; empty for none."""

    @property
    def heading(self) -> str:
        """The title with the unit."""
        return f"{self.title} [{self.unit}]"

    def text(self, values: Sequence[float]) -> str:
        """Write the numbers as people read them; NaN is missing."""
        texts = [self._number(value) for value in values]
        return MISSING if all(map(isnan, values)) else " / ".join(texts)

    def _number(self, value: float) -> str:
        factor, places = UNITS[self.unit]
        return MISSING if isnan(value) else f"{factor * value:.{places}f}"


def fitted(quantity: Quantity, values: pd.DataFrame) -> Quantity:
    """Return a quantity with the unit that fits the first ones of these values."""
    is_small = quantity.unit == "m" and values[0].median() < MILLIMETRES_BELOW_M
    return replace(quantity, unit="mm") if is_small else quantity


def numbers_of(evaluation: Evaluation, quantity: Quantity) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return values and sample sizes, one column per selector, by sequence and method; empty if there are none."""
    parts = [selected(evaluation, selector) for selector in quantity.selectors]
    values, counts = (pd.concat([part[name] for part in parts], axis=1, keys=range(len(parts))) for name in parts[0])
    return values, counts


def is_measured(evaluation: Evaluation, quantity: Quantity) -> bool:
    """Return whether any method has a number of a quantity in any sequence."""
    return bool(numbers_of(evaluation, quantity)[0].notna().any(axis=None))


def selected(evaluation: Evaluation, selector: Selector) -> pd.DataFrame:
    """Select measurements, but no errors of measured pixels where these are the reference: methods were given them."""
    masks = HIDDEN_MASKS if selector.mask == HIDDEN else (selector.mask,)
    found = pd.concat([select(evaluation.measurements, selector._replace(mask=mask)) for mask in masks])
    if selector.mask in ("all", "measured") and selector.metric != "coverage":
        independent = [info.name for info in evaluation.sequences.values() if info.reference.is_independent]
        return found[found.index.isin(independent, level="sequence")]
    return found


def said_and_right(mask: str) -> list[Selector]:
    """Select what the confidence of some pixels says, how many of them are right, and the calibration error."""
    return [Selector(metric, mask, ALL, FILLED) for metric in (*OVERALL, CALIBRATION_ERROR)]


CONFIDENCE = Quantity(
    "Confidence of fills, at any range: said / right / calibration error",
    "%",
    said_and_right(HIDDEN),
    "Said is the mean confidence, and right the share whose disparity is within 5 % or a quarter of a pixel. The error "
    "is the mean difference of the two in six equal bins of confidence.",
)
TIME = Quantity(
    "Time per frame, median / 95th percentile / in threads of its own beside that",
    "ms",
    [of_frames(f"latency_{name}") for name in ("p50", "p95", "background")],
    "OpenCV on one thread, one method at a time, after a warm-up. The third number is the mean CPU time of a method's "
    "own threads: voxdepth fuses its window in one.",
)
ERROR_IN_HOLES = Quantity(
    "MAE in the sensor's holes (held-out pixels where there is no truth), within 20 m, after completion",
    "m",
    [Selector("mae", HIDDEN)],
    best="low",
)
# fmt: off
QUANTITIES = (
    Quantity("Coverage: pixels with depth, surfaces within 20 m", "%", [Selector("coverage", on=FILLED)],
             "Errors of methods that fill less than 90 % say little beside those of others."),
    Quantity("MAE of the pixels that a method fills, surfaces within 20 m", "m", [Selector("mae", on=FILLED)],
             "Not comparable where coverages differ: a method that leaves the hard pixels out errs less."),
    Quantity("MAE of all pixels within 20 m, after completion by the nearest valid", "m", [Selector("mae")],
             best="low"),
    ERROR_IN_HOLES,
    Quantity("More than 10 % too far / too near in those holes (held-out pixels), within 20 m, after completion", "%",
             [Selector("too_far", HIDDEN), Selector("too_near", HIDDEN)],
             "Together, because a bias to one side wins either alone."),
    Quantity("Flicker: mean change of the error of static pixels within 20 m from frame to frame", "m",
             [Selector("flicker", STATIC, on=FILLED)],
             "Without the truth it is the change of the depth, where the gray image hardly changes."),
    TIME,
    Quantity("Coverage of the sensor's holes (held-out pixels), within 20 m", "%",
             [Selector("coverage", HIDDEN, on=FILLED)]),
    Quantity("Flying fills: those beside a depth edge that hang between the surfaces, at any range", "%",
             [Selector(FLYING, HIDDEN, ALL, FILLED)],
             "Farther than 1 px and 3 % of disparity from each reference within 9x9 pixels, and between them. Reliable "
             "where references are dense, as the truth and held-out pixels are; later frames leave gaps.", best="low"),
    CONFIDENCE,
    Quantity(f"Fills believed from a confidence of {BELIEVED} on / right of these", "%",
             [Selector(metric, HIDDEN, ALL, FILLED) for metric in BELIEVED_SHARES]),
    Quantity("Confidence of measured pixels, at any range: said / right / calibration error", "%",
             said_and_right(MEASURED),
             "Pixels whose depth a method replaces are not among them."),
    Quantity(f"Measured pixels believed from a confidence of {BELIEVED} on / right of these", "%",
             [Selector(metric, MEASURED, ALL, FILLED) for metric in BELIEVED_SHARES]),
    Quantity("MAE of measured pixels within 20 m", "m", [Selector("mae", MEASURED, on=FILLED)], best="low"),
    Quantity("Survival: pixels of moving objects within 5 % of the truth, by the method / of raw depth", "%", SURVIVAL,
             "A hole does not survive. Only sequences with known moving objects have it.", best="high"),
    Quantity("Ghosts: filled pixels nearer to the object that left 5 frames ago than to the background, by the method "
             "/ of raw depth", "%", GHOSTS,
             "Nearer by the geometric mean. A method that leaves such pixels empty has no ghosts: see the sample "
             "sizes.", best="low"),
)
"""What the report shows, a table of all methods on all sequences each."""
# fmt: on
