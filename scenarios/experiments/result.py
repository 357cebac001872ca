"""What an experiment gives: tables, a figure, and what the paper says beside what was found."""

from collections.abc import Mapping, Sequence

from pydantic import ConfigDict, Field

from voxdepth.model import Model

NOTHING = "-"
"""What people read where there is no value."""
Value = str | int | float | None
"""One place of a table; None if it is not known or not defined."""


class Column(Model):
    """One quantity."""

    name: str
    unit: str = ""
    """Empty for a name, a count or a ratio."""
    places: int = 2
    """Digits after the point, where a person reads it; files keep all."""

    @property
    def title(self) -> str:
        """With the unit, as in `time [ms]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def text_of(value: Value, column: Column) -> str:
    """A value as people read it."""
    if value is None:
        return NOTHING
    return f"{value:.{column.places}f}" if isinstance(value, float) else str(value)


class Table(Model):
    """Numbers with their units."""

    model_config = ConfigDict(allow_inf_nan=True, ser_json_inf_nan="constants")

    name: str = "table"
    """Of its file, without the suffix."""
    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    """Each as long as `columns`."""

    @classmethod
    def of(cls, title: str, columns: Sequence[Column], rows: Sequence[Sequence[Value]], name: str = "table") -> "Table":
        """A table whose rows are as long as its columns.

        Raises:
            ValueError: A row is of another length.
        """
        for row in rows:
            if len(row) != len(columns):
                raise ValueError(f"expected {len(columns)} values in a row of {title!r}, got {len(row)}")
        return cls(name=name, title=title, columns=tuple(columns), rows=tuple(tuple(row) for row in rows))

    def column(self, name: str) -> list[Value]:
        """The values of a column, by its name without the unit."""
        place = [column.name for column in self.columns].index(name)
        return [row[place] for row in self.rows]


class Claim(Model):
    """What the paper says, and what was found here."""

    paper: str
    found: str
    holds: bool | None
    """Whether the finding agrees; None if it can neither confirm nor deny."""


class Result(Model):
    """All that an experiment found."""

    tables: tuple[Table, ...] = Field(min_length=1)
    """The first one answers the question."""
    claims: tuple[Claim, ...] = ()
    notes: tuple[str, ...] = ()
    """What is different from the paper's experiment, and what a reader must know."""
    figure: bytes = Field(exclude=True)
    """PNG."""
    pictures: Mapping[str, bytes] = Field(default={}, exclude=True)
    """PNGs beside it, by the names of their files without the suffix."""

    @property
    def table(self) -> Table:
        """The one that answers the question."""
        return self.tables[0]
