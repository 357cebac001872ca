"""Rows of small data that are written together: one by one, they take about ten times as long."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import rerun as rr

from voxdepth.types import FloatArray

ROWS_AT_ONCE = 200
"""Rows of an entity that are kept before they are written."""
Columns = Callable[[Sequence[Any]], rr.ComponentColumnList]
"""Makes the columns of an entity from the values of its rows."""


class ColumnWriter:
    """Writes rows of entities in columns, at the times at which they were added."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        self._now = (0, 0.0)
        self._rows: dict[str, tuple[Columns, list[tuple[int, float]], list[Any]]] = {}

    def set_time(self, step: int, time_s: float) -> None:
        """Set the time of the next rows."""
        self._now = step, time_s

    def add(self, entity: str, columns: Columns, value: Any) -> None:
        """Add a row of an entity, whose rows all have the same kind of columns."""
        _, times, values = self._rows.setdefault(entity, (columns, [], []))
        times.append(self._now)
        values.append(value)
        if len(values) == ROWS_AT_ONCE:
            self._write(entity)

    def flush(self) -> None:
        """Write all rows that were added."""
        for entity in list(self._rows):
            self._write(entity)

    def _write(self, entity: str) -> None:
        columns, times, values = self._rows.pop(entity)
        steps, times_s = zip(*times, strict=True)
        indexes = [rr.TimeColumn("step", sequence=steps), rr.TimeColumn("sim_time", duration=times_s)]
        self._stream.send_columns(entity, indexes=indexes, columns=columns(values))


def poses(rows: Sequence[tuple[FloatArray, FloatArray]]) -> rr.ComponentColumnList:
    """Columns of positions, shape (3,), and quaternions (x, y, z, w)."""
    translations, quaternions = map(np.array, zip(*rows, strict=True))
    return rr.Transform3D.columns(translation=translations, quaternion=quaternions)


def places(rows: Sequence[FloatArray]) -> rr.ComponentColumnList:
    """Columns of positions, shape (3,), of what does not turn."""
    return rr.Transform3D.columns(translation=np.array(rows))


def arrows(rows: Sequence[tuple[FloatArray, FloatArray]]) -> rr.ComponentColumnList:
    """Columns of one arrow per row: its origin and its vector."""
    origins, vectors = map(np.array, zip(*rows, strict=True))
    return rr.Arrows3D.columns(origins=origins, vectors=vectors)


def plane_arrows(rows: Sequence[tuple[FloatArray, FloatArray]]) -> rr.ComponentColumnList:
    """Columns of one arrow in an image per row: its origin and its vector [px]."""
    origins, vectors = map(np.array, zip(*rows, strict=True))
    return rr.Arrows2D.columns(origins=origins, vectors=vectors)


def points(rows: Sequence[FloatArray]) -> rr.ComponentColumnList:
    """Columns of points in space, shape (n, 3), any number per row."""
    return rr.Points3D.columns(positions=np.concatenate(rows)).partition([len(row) for row in rows])


def labelled_points(rows: Sequence[tuple[FloatArray, npt.NDArray[np.uint8]]]) -> rr.ComponentColumnList:
    """Columns of points in space, shape (n, 3), with the number of their class, shape (n,); any number per row."""
    positions, classes = map(np.concatenate, zip(*rows, strict=True))
    lengths = [len(points) for points, _ in rows]
    return rr.Points3D.columns(positions=positions, class_ids=classes).partition(lengths)


def words(rows: Sequence[str]) -> rr.ComponentColumnList:
    """Columns of states."""
    return rr.StateChange.columns(state=rows)


def scalars(rows: Sequence[float]) -> rr.ComponentColumnList:
    """Columns of numbers."""
    return rr.Scalars.columns(scalars=rows)
