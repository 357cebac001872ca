"""Data frames as files."""

import io
from pathlib import Path

import pandas as pd
from pandas.api.types import is_numeric_dtype

from .files import write
from .table import csv_entry


def write_frame(stem: Path, frame: pd.DataFrame) -> list[Path]:
    """Write a frame as `STEM.csv` and `STEM.parquet`, each in one step, and return both paths.

    The frame has the column types that the Parquet file shall have. A failure is a `ToolError`.
    """
    parquet = io.BytesIO()
    frame.to_parquet(parquet, index=False)
    texts = {name: frame[name].map(csv_entry) for name in frame if not is_numeric_dtype(frame[name])}
    files = {
        ".csv": frame.assign(**texts).to_csv(index=False, lineterminator="\n").encode(),
        ".parquet": parquet.getvalue(),
    }
    for suffix, data in files.items():
        write(stem.with_name(stem.name + suffix), data)
    return [stem.with_name(stem.name + suffix) for suffix in files]
