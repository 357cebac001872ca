"""The long table of figures, one row per number, and how frames are kept in files."""

import io
from pathlib import Path

import pandas as pd

from ..files import write

MEASUREMENT_COLUMNS = ("sequence", "method", "metric", "mask", "range", "on", "value", "unit", "n", "error")
"""Of the long table: what was measured on which pixels, the number with its unit, and its sample size. `error` says why
a method has no figures, and is empty otherwise."""


def write_frame(stem: Path, frame: pd.DataFrame) -> list[Path]:
    """Write a frame as `STEM.csv` and `STEM.parquet`, each in one step.

    Args:
        stem: Path of the files without the suffix.
        frame: With the column types that the Parquet file shall have.

    Returns:
        The paths of both files.

    Raises:
        ScenarioError: A file cannot be written.
    """
    parquet = io.BytesIO()
    frame.to_parquet(parquet, index=False)
    files = {".csv": frame.to_csv(index=False, lineterminator="\n").encode(), ".parquet": parquet.getvalue()}
    for suffix, data in files.items():
        write(stem.with_name(stem.name + suffix), data)
    return [stem.with_name(stem.name + suffix) for suffix in files]
