"""Bars: what is asked of a method in one number, and by how much what was measured holds or misses it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import mean

from .result import Column, Table, Value

HELD, UNKNOWN = "held", "not measured"
COLUMNS = (
    Column(name="what"),
    Column(name="asked"),
    Column(name="measured"),
    Column(name="of"),
    Column(name="verdict"),
)


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A bound that a number must not pass."""

    what: str
    bound: float
    unit: str = ""
    at_least: bool = False
    """Whether the number must be at least the bound, and not at most."""

    @property
    def asked(self) -> str:
        """As people read it."""
        return f"at {'least' if self.at_least else 'most'} {self.bound:g}{self._unit}"

    def shown(self, value: float | None) -> str:
        """A number in the unit of the bar."""
        return UNKNOWN if value is None else f"{value:.2f}{self._unit}"

    def verdict(self, value: float | None) -> str:
        """`held`, `missed by` how much, or `not measured`."""
        if value is None:
            return UNKNOWN
        missed = self.bound - value if self.at_least else value - self.bound
        if missed <= 0:
            return HELD
        return f"missed by {missed:.2f}{self._unit}" if missed >= 0.005 else f"missed by {missed:.1g}{self._unit}"

    @property
    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""


@dataclass(frozen=True, kw_only=True)
class Finding:
    """What was measured against a bar."""

    bar: Bar
    value: float | None
    of: str
    """Which sequence or sequences the number is of."""

    @property
    def row(self) -> Sequence[Value]:
        """By `COLUMNS`."""
        return self.bar.what, self.bar.asked, self.bar.shown(self.value), self.of, self.bar.verdict(self.value)


Values = Mapping[str, float | None]
"""One number for each sequence; None where it is not defined."""


def worst(bar: Bar, values: Values) -> Finding:
    """The number of the sequence that is hardest on the bar."""
    known = _known(values)
    if not known:
        return Finding(bar=bar, value=None, of="no sequence")
    name = (min if bar.at_least else max)(known, key=lambda name: known[name])
    return Finding(bar=bar, value=known[name], of=f"{name}, worst of {len(known)}")


def average(bar: Bar, values: Values) -> Finding:
    """The mean over the sequences that have the number."""
    known = _known(values)
    return Finding(bar=bar, value=mean(known.values()) if known else None, of=f"mean of {len(known)}")


def bars_table(findings: Sequence[Finding]) -> Table:
    """All findings below each other, with their verdicts counted in the title."""
    verdicts = [finding.bar.verdict(finding.value) for finding in findings]
    held, unknown = verdicts.count(HELD), verdicts.count(UNKNOWN)
    title = f"Bars: {held} held, {len(verdicts) - held - unknown} missed, {unknown} not measured"
    return Table.of(title, COLUMNS, [finding.row for finding in findings])


def _known(values: Values) -> dict[str, float]:
    return {name: value for name, value in values.items() if value is not None}
