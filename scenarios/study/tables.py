"""The tables of a study's report, as text."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from swarm.types import Outcome

from ..tabulate import markdown_head, markdown_row
from .analysis import CONTACT_KINDS, Comparison, Point
from .figures import COLORS
from .growth import B_BOUNDS, Growth
from .statistics import Interval

OTHER_OUTCOMES = tuple(outcome for outcome in COLORS if outcome is not Outcome.COLLISION)


class Table(NamedTuple):
    """Rows of text below their heads."""

    head: Sequence[str]
    rows: Sequence[Sequence[str]]

    @property
    def markdown(self) -> str:
        """To be pasted into a document."""
        lines = [
            *markdown_head(self.head),
            *(markdown_row([cell.replace("|", "\\|") for cell in row]) for row in self.rows),
        ]
        return "\n".join(lines) + "\n"


def of_points(points: Iterable[Point]) -> Table:
    """Every arm in every scenario."""
    head = ["scenario", "arm", "runs", "collisions", "ratio", "Wilson", "Clopper-Pearson"]
    head += [outcome.value for outcome in OTHER_OUTCOMES]
    head += [f"contacts: {kind}" for kind in CONTACT_KINDS]
    head += ["mission time [s]", "depth error, MAE [m]", "without depth [%]"]
    return Table(head, [_point_row(point) for point in points])


def of_comparisons(comparisons: Iterable[Comparison]) -> Table:
    """Every pair of arms."""
    head = ["first - second", "", "pairs", "b", "c", "difference", "95 % interval", "p", "p after Holm"]
    return Table(head, [_comparison_row(comparison) for comparison in comparisons])


def of_growths(growths: Iterable[tuple[str, str, Growth | str]]) -> Table:
    """Every arm with noise ratios."""
    head = ["scenario", "arm", "seeds", "a", "b", "p(1.0) / p(0.5)", ""]
    return Table(head, [[scenario, arm, *_growth_row(growth)] for scenario, arm, growth in growths])


def _point_row(point: Point) -> Sequence[str]:
    time_s, n_time = point.mean("sim_time_s", Outcome.SUCCESS)
    mae_m, n_mae = point.mean("depth_corrected_mae_m")
    hole_share, _ = point.mean("depth_corrected_hole_share")
    return [
        point.scenario,
        point.label,
        f"{point.n} of {point.planned}",
        f"{point.collisions}",
        "-" if point.ratio is None else f"{point.ratio:.3f}",
        _interval(point.wilson),
        _interval(point.clopper_pearson),
        *(str(point.count(outcome)) for outcome in OTHER_OUTCOMES),
        *(str(point.contacts(kind)) for kind in CONTACT_KINDS),
        "-" if time_s is None else f"{time_s:.1f} (n = {n_time})",
        "-" if mae_m is None else f"{mae_m:.3f} (n = {n_mae})",
        "-" if hole_share is None else f"{100 * hole_share:.1f}",
    ]


def _comparison_row(comparison: Comparison) -> Sequence[str]:
    pairs = comparison.pairs
    return [
        f"{comparison.first} - {comparison.second}",
        "declared" if comparison.declared else "other",
        str(pairs.n),
        str(pairs.first_only),
        str(pairs.second_only),
        f"{pairs.difference:+.3f}",
        _interval(comparison.difference, signed=True),
        p_text(comparison.p),
        "-" if comparison.p_holm is None else p_text(comparison.p_holm),
    ]


def _growth_row(growth: Growth | str) -> Sequence[str]:
    if isinstance(growth, str):
        return ["-"] * 4 + [f"no fit: {growth}"]
    curve = growth.curve
    notes = [f"{growth.resamples} resamples, seed {growth.bootstrap_seed}"]
    if curve.at_bound:
        notes.append(f"b ends at a bound of the search ({B_BOUNDS[0]:g} to {B_BOUNDS[1]:g}): not told by these runs")
    return [
        str(growth.seeds),
        f"{curve.a:.3f} {_interval(growth.a)}",
        f"{curve.b:.2f} {_interval(growth.b)}",
        f"{curve.ratio:.3g} {_interval(growth.ratio)}",
        "; ".join(notes),
    ]


def _interval(interval: Interval | None, *, signed: bool = False) -> str:
    if interval is None:
        return "-"
    kind = "+.3f" if signed else ".3f" if interval.high < 100 else ".3g"
    return f"[{interval.low:{kind}}, {interval.high:{kind}}]"


def p_text(p: float) -> str:
    """A p-value with as many digits as matter."""
    return "< 0.0001" if p < 0.0001 else f"{p:.4f}"
