"""The output of an evaluation: tables, a page without scripts or external parts, and the terminal output."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from ... import registry
from ..files import write
from ..page import TEMPLATES, render_page
from ..provenance import CORRECTION, Provenance
from ..table import MISSING, Column, Table, write_frame
from .figures import all_figures, error_maps, range_text
from .groups import ALL, NEAR
from .methods import ORACLE
from .quantities import QUANTITIES, Quantity, fitted, is_measured, select
from .suite import Evaluation
from .verdict import verdict

if TYPE_CHECKING:
    from rich.console import Console

FAILED = "failed"
FOOTNOTE = (
    "surfaces within 20 m; errors of all, and in holes, are after completion by the nearest valid, and far/near is the "
    "share of holes that is more than 10 % off then; within 5 % counts empty pixels as wrong, with a 95 % bootstrap "
    "interval over frames; survival and ghosts are those of moving objects; times are with OpenCV on one thread"
)


def write_report(out: Path, evaluation: Evaluation) -> None:
    """Write `results.csv`, `results.parquet` and `report.html`, each in one step; a failure is a `ToolError`."""
    write_frame(out / "results", evaluation.measurements.frame)
    write(out / "report.html", rendered(evaluation).encode())


def rendered(evaluation: Evaluation) -> str:
    """Return the text of the page."""
    return render_page(
        TEMPLATES / "report.html.j2",
        verdict=verdict(evaluation),
        failures=_failure_rows(evaluation),
        tables=[method_table(evaluation, q) for q in QUANTITIES if is_measured(evaluation, q)],
        figures=all_figures(evaluation),
        error_maps=error_maps(evaluation),
        sequences=_sequence_table(evaluation),
        machine=Provenance.here(CORRECTION),
    )


def method_table(evaluation: Evaluation, quantity: Quantity) -> Table:
    """Return a table with one row per method, one column per sequence, and the sample sizes in the last row.

    Methods that failed everywhere are left out, and sequences without a number if another has one.
    """
    quantity, texts, classes, counts = _shown(evaluation, quantity)
    methods = [name for name in texts.index if not (texts.loc[name] == FAILED).all()]
    measured = [name for name in texts if not texts[name].isin([MISSING, FAILED]).all()] or list(texts)
    rows = [[registry.title(name), *texts.loc[name, measured]] for name in methods]
    rows.append(["n", *(counts[name] for name in measured)])
    marks = [["", *classes.loc[name, measured]] for name in methods] + [["", *["n"] * len(measured)]]
    return Table.of(quantity.heading, ["method", *measured], rows, note=quantity.note, classes=marks)


def print_results(console: "Console", evaluation: Evaluation) -> None:
    """Print the verdict and a table for each sequence, and say which methods failed."""
    console.print(verdict(evaluation), "", sep="\n", soft_wrap=True, markup=False, highlight=False)
    found = [_shown(evaluation, quantity) for quantity in QUANTITIES if quantity.short]
    for info in evaluation.sequences.values():
        pixels = info.pixels[ALL].get(NEAR, 0)
        title = f"{info.name}: {info.frames} frames of {info.size}, {pixels:,} pixels within 20 m"
        console.print(f"{title}, scored by {info.reference_name}", soft_wrap=True, markup=False)
        known = [one for one in found if not one.texts[info.name].isin([MISSING, FAILED]).all()]
        columns = [Column("method"), *(Column(one.quantity.short, one.quantity.unit) for one in known)]
        rows = zip(evaluation.methods, *(one.texts[info.name] for one in known), strict=True)
        Table.of("", columns, list(rows)).print(console)
    console.print(FOOTNOTE, soft_wrap=True)
    for result in evaluation.failures:
        failed = f"{result.key.sequence}, {result.key.method} failed: {result.error}"
        console.print(failed, soft_wrap=True, markup=False, style="red")


class Shown(NamedTuple):
    """A quantity as people read it, in the unit that fits."""

    quantity: Quantity
    texts: pd.DataFrame
    """Text of every result (rows: methods; columns: sequences)."""
    classes: pd.DataFrame
    """CSS class of every result."""
    sizes: dict[str, str]
    """Sample sizes by sequence."""


def _shown(evaluation: Evaluation, quantity: Quantity) -> Shown:
    values, counts = select(evaluation, quantity)
    quantity = fitted(quantity, values)
    failed = dict.fromkeys(((result.key.sequence, result.key.method) for result in evaluation.failures), FAILED)
    texts = dict(zip(values.index, map(quantity.text, values.itertuples(index=False, name=None)), strict=True)) | failed
    classes = dict.fromkeys(_best(quantity, values[0]), "best") | failed
    methods, sequences = evaluation.methods, list(dict.fromkeys(result.key.sequence for result in evaluation.results))

    def grid(entries: Mapping[tuple[str, str], str], missing: str) -> pd.DataFrame:
        return pd.DataFrame([[entries.get((s, m), missing) for s in sequences] for m in methods], methods, sequences)

    sizes = dict.fromkeys(sequences, MISSING)
    for name, low, high in counts.stack().groupby("sequence").agg(["min", "max"]).astype(int).itertuples(name=None):
        sizes[name] = range_text(low, high)
    return Shown(quantity, grid(texts, MISSING), grid(classes, ""), sizes)


def _best(quantity: Quantity, values: pd.Series) -> list[tuple[str, str]]:
    """Return sequence and method of the best values of each sequence; none is best where all are equal.

    An oracle does not compete.
    """
    if not quantity.best:
        return []
    competing = values[values.index.get_level_values("method") != ORACLE]
    low, high = (competing.groupby("sequence").transform(end) for end in ("min", "max"))
    best = low if quantity.best == "low" else high
    return list(competing.index[(competing == best) & (low < high)])


def _failure_rows(evaluation: Evaluation) -> list[tuple[str, str, str]]:
    """Return a method, the sequences that it failed on, and why; one row for the same reason."""
    sequences: dict[tuple[str, str], list[str]] = {}
    for result in evaluation.failures:
        sequences.setdefault((result.key.method, str(result.error)), []).append(result.key.sequence)
    return [(method, ", ".join(names), why) for (method, why), names in sequences.items()]


def _sequence_table(evaluation: Evaluation) -> Table:
    rows = [
        {
            "sequence": info.name, "scored by": info.reference_name, "frames": info.frames, "image [px]": info.size,
            "focal length [px]": info.camera.fx_px, "baseline [m]": info.camera.baseline_m, "seed": info.seed,
            "scored pixels": info.pixels[ALL][ALL],
            "not measured, or held out [%]": 100 * info.pixels[info.hidden][ALL] / max(1, info.pixels[ALL][ALL]),
            "of those without depth, judged [%]": 100 * info.judged_share,
            "SHA-256": info.digest[:16],
        }
        for info in evaluation.sequences.values()
    ]  # fmt: skip
    return Table.of_frame("Sequences", pd.DataFrame(rows, dtype=object))
