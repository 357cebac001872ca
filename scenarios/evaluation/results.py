"""All figures as one tidy table: a row for each number, and one for each cell that has none."""

import csv
import io
from collections.abc import Iterator, Sequence
from pathlib import Path

from ..files import write
from .cell import Cell

COLUMNS = ("sequence", "method", "metric", "mask", "within", "on", "value", "unit", "n", "error")
CSV, PARQUET = "results.csv", "results.parquet"

Row = tuple[str, str, str, str, str, str, float | None, str, int, str]
"""By `COLUMNS`; the value is None where it is not defined, and the error empty where there is none."""


def rows(cells: Sequence[Cell]) -> Iterator[Row]:
    """The rows of cells, in their order."""
    for cell in cells:
        sequence, method = cell.key.sequence, cell.key.method
        if cell.error is not None:
            yield sequence, method, "error", "", "", "", None, "", 0, cell.error
        for f in cell.figures:
            yield sequence, method, f.metric, f.mask, f.within, f.on, f.value, f.unit, f.n, ""


def write_results(out: Path, cells: Sequence[Cell]) -> None:
    """Write `results.csv` and `results.parquet`, each in one step.

    Raises:
        ScenarioError: One cannot be written.
    """
    listed = list(rows(cells))
    write(out / CSV, _csv(listed))
    write(out / PARQUET, _parquet(listed))


def _csv(listed: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(listed)
    return text.getvalue().encode()


def _parquet(listed: Sequence[Row]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    kinds = {"value": pyarrow.float64(), "n": pyarrow.int64()}
    columns = zip(*listed, strict=True) if listed else [()] * len(COLUMNS)
    arrays = {
        name: pyarrow.array(list(column), type=kinds.get(name, pyarrow.string()))
        for name, column in zip(COLUMNS, columns, strict=True)
    }
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(arrays), sink)
    return bytes(sink.getvalue().to_pybytes())
