"""The output of an evaluation: tables, a page without scripts or external parts, and the terminal output."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from ... import registry
from ...colors import ERROR_END
from ..files import write
from ..results.interval import Interval
from ..results.page import TEMPLATES, render_page
from ..results.provenance import Provenance
from ..results.table import MISSING, Table, write_frame
from .curves import plots_of, untold
from .frames import RANGES
from .measurements import FILLED, Selector, of_frames
from .pictures import depth_scale, error_scale
from .quantities import HIDDEN, QUANTITIES, Quantity, fitted, is_measured, numbers_of, selected
from .record import SequenceInfo
from .reliability import TOO_FEW
from .shares import PixelKind, Shares
from .suite import Evaluation
from .verdict import verdict

if TYPE_CHECKING:
    from rich.console import Console

SHARES = "share of the hidden pixels within 5 % of the reference, with a 95 % interval [%]"
JUDGED = ("judged [%]", "judged [px]")
"""Rows that say which share of the pixels of a kind has a reference, and how many they are."""
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
        shares=[share_table(evaluation, shares) for shares in evaluation.shares],
        tables=[method_table(evaluation, q) for q in QUANTITIES if is_measured(evaluation, q)],
        ranges=range_table(evaluation),
        plots=plots_of(evaluation),
        untold=_untold(evaluation),
        pictures=[shown_frame(evaluation, info) for info in evaluation.sequences.values()],
        error_percent=round(100 * ERROR_END),
        error_scale=error_scale(),
        sequences=_sequence_table(evaluation),
        unjudged=_unjudged(evaluation),
        machine=Provenance.here().lines(),
    )


def _untold(evaluation: Evaluation) -> list[str]:
    """Say of which sequences no reliability can be reported, if any."""
    names = untold(evaluation)
    return [f"No reliability can be told of {', '.join(names)}: {TOO_FEW}."] if names else []


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


def share_table(evaluation: Evaluation, shares: Shares) -> Table:
    """Return the shares of close pixels of one recording: a row for each method, a column for each kind of pixels."""
    columns = {kind.title: _share_texts(evaluation, name, kind) for name, kind in shares.kinds.items()}
    columns["lead over the best other"] = _lead_texts(shares.overall)
    texts = pd.DataFrame(columns).reindex([*JUDGED, *evaluation.methods]).fillna(MISSING)
    rows = [[registry.title(method), *texts.loc[method]] for method in texts.index]
    return Table.of(f"{shares.recording}: {SHARES}", ["method", *texts], rows)


def _share_texts(evaluation: Evaluation, sequence: str, kind: PixelKind) -> dict[str, str]:
    """Return the share of each method, how much was evaluated, and which methods failed in a sequence."""
    texts = dict(zip(JUDGED, (f"{100 * kind.evaluated_share:.1f}", f"{kind.evaluated:,}"), strict=True))
    texts |= {method: _percent(kind.share(method)) for method in kind.ranked}
    best, *others = kind.ranked or [""]
    if others and kind.share(best).value > kind.share(others[0]).value:
        texts[best] += f" {BEST}"
    return texts | {result.method: FAILED for result in evaluation.failures if result.sequence == sequence}


def _lead_texts(kind: PixelKind) -> dict[str, str]:
    """Return the lead of each method over the best other one."""
    others = {method: kind.best_other(method) for method in kind.ranked}
    return {method: _percent(kind.lead(method, other)) for method, other in others.items() if other}


def _percent(share: Interval) -> str:
    return share.scaled(100).text(".1f")


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
    errors_m, close = (selected(evaluation, Selector(metric, HIDDEN, name, FILLED)) for metric in ("mae", "close"))
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
    """Print the verdict, the shares of close pixels with the time, and which methods failed.

    The page has intervals and all other tables.
    """
    for line in (*verdict(evaluation), *_unjudged(evaluation)):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    for table in summary_tables(evaluation):
        table.print(console)
    for line in _untold(evaluation):
        console.print(line, soft_wrap=True, markup=False, highlight=False)
    for result in evaluation.failures:
        failed = f"{result.sequence}, {result.method} failed: {result.error}"
        console.print(failed, soft_wrap=True, markup=False, style="red")


def summary_tables(evaluation: Evaluation) -> Iterator[Table]:
    """Yield the tables of the terminal: recordings with one kind of pixels in columns, and a table of each other."""
    simple = {shares.recording: shares.overall for shares in evaluation.shares if len(shares.kinds) == 1}
    if simple:
        yield _summary(evaluation, f"{len(simple)} recording{'s' * (len(simple) > 1)}", simple, list(simple))
    for shares in evaluation.shares:
        if len(shares.kinds) > 1:
            kinds = {kind.title: kind for kind in shares.kinds.values()}
            yield _summary(evaluation, shares.recording, kinds, list(shares.kinds))


def _summary(evaluation: Evaluation, of: str, kinds: Mapping[str, PixelKind], sequences: Sequence[str]) -> Table:
    """Return the shares of close pixels by method and kind, and the median time of a frame in some sequences."""
    failed = {result.method for result in evaluation.failures if result.sequence in sequences}
    columns = {title: dict.fromkeys(failed, FAILED) | _short_texts(kind) for title, kind in kinds.items()}
    times_ms = selected(evaluation, of_frames("latency_p50"))["value"]
    in_these = times_ms[times_ms.index.isin(sequences, level="sequence")].groupby("method").median()
    columns["time [ms]"] = {method: f"{time_ms:.1f}" for method, time_ms in in_these.items()}
    texts = pd.DataFrame(columns).reindex(evaluation.methods).fillna(MISSING)
    rows = [[registry.title(method), *texts.loc[method]] for method in texts.index]
    return Table.of(f"{of}: hidden pixels within 5 % of the reference [%]", ["method", *texts], rows)


def _short_texts(kind: PixelKind) -> dict[str, str]:
    """Return the share of each method without its interval, with a mark at the best one."""
    shares = {method: kind.share(method).value for method in kind.ranked}
    best = [method for method in kind.ranked[:1] if shares[method] > min(shares.values())]
    return {method: f"{100 * share:.1f}" + f" {BEST}" * (method in best) for method, share in shares.items()}


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
            "sequence": info.name, "scored by": info.reference.name, "frames": f"{info.frames} of {info.all_frames}",
            "time [s]": _seconds(info), "image [px]": info.size,
            "seed": info.seed, "scored pixels": info.pixels,
        }
        for info in evaluation.sequences.values()
    ]  # fmt: skip
    return Table.of_frame("Sequences", pd.DataFrame(rows, dtype=object))


def _unjudged(evaluation: Evaluation) -> list[str]:
    """Say of which recordings only the first frames were evaluated, if any, and how to evaluate others."""
    partly = {info.recording: info for info in evaluation.sequences.values() if info.frames < info.all_frames}
    if not partly:
        return []
    of = [
        f"{info.frames} of the {info.all_frames} frames of {name} from --start on ({_seconds(info)} s)"
        for name, info in partly.items()
    ]
    return [f"Only {', '.join(of)} were judged: --frames judges more, and --start others."]


def _seconds(info: SequenceInfo) -> str:
    """Return the time stamps of the first and of the last evaluated frame."""
    return " to ".join(f"{stamp_s:.2f}" for stamp_s in info.span_s)
