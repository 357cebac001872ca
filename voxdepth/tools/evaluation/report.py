"""The output of an evaluation: tables, a page without scripts or external parts, and the terminal output."""

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ... import registry
from ...colors import ERROR_END
from ..files import write
from ..page import TEMPLATES, render_page
from ..provenance import Provenance
from ..table import MISSING, Table, write_frame
from .curves import plots_of, untold
from .frames import HOLES, RANGES
from .measurements import FILLED, Selector, select
from .pictures import depth_scale, error_scale
from .quantities import HEADLINES, QUANTITIES, Quantity, fitted, is_measured, numbers_of
from .reliability import TOO_FEW
from .results import SequenceInfo
from .suite import Evaluation
from .verdict import verdict

if TYPE_CHECKING:
    from rich.console import Console

FAILED, BEST = "failed", "*"
"""Text of a method that failed, and mark of the best one of a sequence."""


def write_report(out: Path, evaluation: Evaluation) -> None:
    """Write `results.csv`, `results.parquet` and `report.html`, each in one step; a failure is a `ToolError`."""
    write_frame(out / "results", evaluation.measurements)
    write(out / "report.html", rendered(evaluation).encode())


def rendered(evaluation: Evaluation) -> str:
    """Return the text of the page."""
    return render_page(
        TEMPLATES / "report.html.j2",
        verdict=verdict(evaluation),
        failures=[(result.method, result.sequence, result.error) for result in evaluation.failures],
        tables=[method_table(evaluation, q) for q in QUANTITIES if is_measured(evaluation, q)],
        ranges=range_table(evaluation),
        plots=plots_of(evaluation),
        untold=_untold(evaluation),
        pictures=[shown_frame(evaluation, info) for info in evaluation.sequences.values()],
        error_percent=round(100 * ERROR_END),
        error_scale=error_scale(),
        sequences=_sequence_table(evaluation),
        machine=Provenance.here().lines(),
    )


def _untold(evaluation: Evaluation) -> list[str]:
    """Say of which sequences no reliability can be told, if any."""
    names = untold(evaluation)
    return [f"No reliability can be told of {', '.join(names)}: {TOO_FEW}"] if names else []


def method_table(evaluation: Evaluation, quantity: Quantity) -> Table:
    """Return a table with one row per method, one column per sequence, and the sample sizes in the last row.

    Methods that failed everywhere are left out, and sequences without a number if another has one.
    """
    values, counts = numbers_of(evaluation, quantity)
    quantity = fitted(quantity, values)
    texts = _texts(evaluation, quantity, values)
    texts = texts[~(texts == FAILED).all(axis="columns")]
    measured = [name for name in texts if not texts[name].isin([MISSING, FAILED]).all()] or list(texts)
    rows = [[registry.title(method), *texts.loc[method, measured]] for method in texts.index]
    ends = counts.stack().groupby("sequence").agg(["min", "max"]).astype(int)
    sizes = {
        name: f"{low:,}" if low == high else f"{low:,} to {high:,}" for name, low, high in ends.itertuples(name=None)
    }
    rows.append(["n", *(sizes.get(name, MISSING) for name in measured)])
    return Table.of(quantity.heading, ["method", *measured], rows, note=quantity.note)


def range_table(evaluation: Evaluation) -> Table:
    """Return the errors of fills by the range of the reference, a row for each method that fills in a sequence."""
    texts = pd.DataFrame({name: _range_texts(evaluation, name) for name in RANGES}).fillna(MISSING)
    rows = [
        [f"{sequence}, {registry.title(method)}", *texts.loc[sequence, method]]
        for sequence, method in itertools.product(evaluation.sequences, evaluation.methods)
        if (sequence, method) in texts.index
    ]
    return Table.of(
        "Fills by the range of the reference: mean error [m] / within 5 % [%] (pixels)", ["method", *RANGES], rows,
        note="Pixels that a method leaves empty are not among them: see its coverage.",
    )  # fmt: skip


def _range_texts(evaluation: Evaluation, name: str) -> pd.Series:
    """Return the errors of the fills in a range by sequence and method."""
    masks = {info.reference.hidden for info in evaluation.sequences.values()}
    errors_m, close = (
        pd.concat([select(evaluation.measurements, Selector(metric, mask, name, FILLED)) for mask in masks or [HOLES]])
        for metric in ("mae", "close")
    )
    values = zip(errors_m["value"], 100 * close["value"], errors_m["n"], strict=True)
    return pd.Series([f"{mae_m:.3f} / {share:.1f} ({n:,})" for mae_m, share, n in values], errors_m.index, dtype=object)


def _texts(evaluation: Evaluation, quantity: Quantity, values: pd.DataFrame) -> pd.DataFrame:
    """Return the text of every result (rows: methods; columns: sequences), given its numbers."""
    texts = dict(zip(values.index, map(quantity.text, values.itertuples(index=False, name=None)), strict=True))
    texts |= {best: f"{texts[best]} {BEST}" for best in _best(quantity, values[0])}
    texts |= {(result.sequence, result.method): FAILED for result in evaluation.failures}
    sequences = list(dict.fromkeys(result.sequence for result in evaluation.results))
    grid = [[texts.get((name, method), MISSING) for name in sequences] for method in evaluation.methods]
    return pd.DataFrame(grid, evaluation.methods, sequences)


def print_results(console: "Console", evaluation: Evaluation) -> None:
    """Print the verdict, the sequences, the tables that most decide, and which methods failed.

    The page has the other tables.
    """
    console.print(verdict(evaluation), soft_wrap=True, markup=False, highlight=False)
    if evaluation.sequences:
        _sequence_table(evaluation).print(console)
    for quantity in HEADLINES:
        if is_measured(evaluation, quantity):
            method_table(evaluation, quantity).print(console)
    for line in _untold(evaluation):
        console.print(f"{line}.", markup=False, highlight=False)
    for result in evaluation.failures:
        failed = f"{result.sequence}, {result.method} failed: {result.error}"
        console.print(failed, soft_wrap=True, markup=False, style="red")


def shown_frame(evaluation: Evaluation, info: SequenceInfo) -> dict[str, Any]:
    """Return the pictures of a sequence by their titles, in columns: the scene, the depth as given, and each method."""
    gray, reference, *given = info.pictures
    scene = [("gray image", gray), (f"scored by {info.reference.name}", reference)]
    columns = [scene] if info.reference.is_true else [[picture] for picture in scene]
    depths = {"raw, as given": given}
    for result in evaluation.results:
        if result.sequence == info.name and result.method != "raw" and result.pictures:
            depths[registry.title(result.method)] = list(result.pictures)
    for title, pictures in depths.items():
        columns.append(list(zip((title, "its relative error"), pictures, strict=False)))
    return {"info": info, "scale": depth_scale(info.far_m), "columns": columns}


def _best(quantity: Quantity, values: pd.Series) -> list[tuple[str, str]]:
    """Return sequence and method of the best values of each sequence; none is best where all are equal."""
    if not quantity.best:
        return []
    low, high = (values.groupby("sequence").transform(end) for end in ("min", "max"))
    best = low if quantity.best == "low" else high
    return list(values.index[(values == best) & (low < high)])


def _sequence_table(evaluation: Evaluation) -> Table:
    rows = [
        {
            "sequence": info.name, "scored by": info.reference.name, "frames": info.frames, "image [px]": info.size,
            "seed": info.seed, "scored pixels": info.pixels,
            "not measured, or held out [%]": 100 * info.hidden_pixels / max(1, info.pixels),
            "of those without depth, judged [%]": 100 * info.judged_share,
        }
        for info in evaluation.sequences.values()
    ]  # fmt: skip
    return Table.of_frame("Sequences", pd.DataFrame(rows, dtype=object))
