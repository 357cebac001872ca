"""An estimate with its confidence interval, and how both are written."""

from math import isnan
from typing import NamedTuple, Self

LEVEL = 0.95
"""Confidence level of every interval."""


class Interval(NamedTuple):
    """An estimate with the ends of its 95 % confidence interval, which are NaN where too little is known."""

    value: float
    low: float
    high: float

    @property
    def is_positive(self) -> bool:
        """Whether all of the interval is above 0."""
        return self.low > 0

    @property
    def is_known(self) -> bool:
        """Whether there is an interval."""
        return not isnan(self.low)

    def scaled(self, factor: float) -> Self:
        """Return it in another unit, as in percent."""
        return type(self)(*(factor * each for each in self))

    def text(self, number: str, unit: str = "") -> str:
        """Return the estimate in its unit, with the interval, if there is one, as in `7.0 points [5.1, 8.8]`.

        Args:
            number: Format specification of the numbers.
            unit: Name of the unit.
        """
        value = f"{self.value:{number}} {unit}".rstrip()
        return f"{value} {self.ends(number)}" if self.is_known else value

    def ends(self, number: str) -> str:
        """Return the interval alone, as in `[5.1, 8.8]`."""
        return f"[{self.low:{number}}, {self.high:{number}}]"
