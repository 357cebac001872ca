"""All runs of a study as one table: a row for each cell of the matrix that has a result."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..errors import ScenarioError
from ..files import write
from .store import Contents

CSV, PARQUET = "runs.csv", "runs.parquet"

Row = dict[str, Any]


def rows(contents: Contents) -> list[Row]:
    """A row for each cell with a result, in the order of the study, with the same columns in each."""
    names = list(dict.fromkeys(name for record in contents.records.values() for name in record.metrics))
    return [
        {
            "scenario": spec.scenario,
            "arm": spec.arm,
            "theta": spec.theta,
            "seed": spec.seed,
            "key": spec.key,
            "outcome": record.outcome.value,
            "contacts": len(record.contacts),
            "wall_s": record.wall_s,
            **{name: record.metrics.get(name) for name in names},
        }
        for spec in contents.cells
        if (record := contents.records.get(spec.key)) is not None
    ]


def export(contents: Contents, out: Path) -> list[Path]:
    """Write `runs.csv` and `runs.parquet`, each in one step.

    Raises:
        ScenarioError: There is no result yet, or a file cannot be written.
    """
    listed = rows(contents)
    if not listed:
        raise ScenarioError(f"the study {contents.study.name!r} has no result yet: fly it first")
    write(out / CSV, _csv(listed))
    write(out / PARQUET, _parquet(listed))
    return [out / CSV, out / PARQUET]


def _csv(listed: Sequence[Row]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, list(listed[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(listed)
    return text.getvalue().encode()


def _parquet(listed: Sequence[Row]) -> bytes:
    import pyarrow
    import pyarrow.parquet

    texts, counts = ("scenario", "arm", "key", "outcome"), ("seed", "contacts")
    kinds = dict.fromkeys(texts, pyarrow.string()) | dict.fromkeys(counts, pyarrow.int64())
    arrays = {
        name: pyarrow.array([row[name] for row in listed], type=kinds.get(name, pyarrow.float64()))
        for name in listed[0]
    }
    sink = pyarrow.BufferOutputStream()
    pyarrow.parquet.write_table(pyarrow.table(arrays), sink)
    return bytes(sink.getvalue().to_pybytes())
