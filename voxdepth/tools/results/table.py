"""Tables with units, from which CSV, Markdown, terminal text and HTML are made."""

import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Self

from ..files import write

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console
    from rich.table import Table as RichTable

Value = str | int | float | None
"""One entry of a table; None if it is unknown or undefined."""
MISSING = "-"
"""Text of an entry that is None or NaN."""
NUMBERS = {"": ".3f", "m": ".3f", "%": ".1f"}
"""How numbers of a frame are written, by their unit; others have two decimal places."""
TERMINAL_WIDTH = 400
"""Characters in a line of a printed table that are never reached: squeezing it would cut its numbers."""
SENTENCE = 50
"""Number of characters from which on a text is wrapped."""


@dataclass(frozen=True)
class Column:
    """A column of a table: its name, its unit, and how its numbers are written."""

    name: str
    unit: str = ""
    """Empty for a name, a count or a ratio."""
    number: str | Callable[[float], str] = ".2f"
    """Format specification of floating-point numbers, or a function that writes one; files keep all digits."""

    @classmethod
    def of(cls, heading: str) -> Self:
        """Return the column of a heading of a frame, as in `time [ms]`."""
        name, _, unit = heading.removesuffix("]").partition(" [")
        return cls(name, unit, NUMBERS.get(unit, ".2f"))

    @property
    def heading(self) -> str:
        """The name with the unit, as in `time [ms]`."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name

    def text(self, value: Value) -> str:
        """Return a value as people read it."""
        if value is None or (isinstance(value, float) and isnan(value)):
            return MISSING
        if isinstance(value, float):
            return self.number(value) if callable(self.number) else f"{value:{self.number}}"
        return str(value)


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Values with their units, and how they are presented; pages leave out a table without rows."""

    title: str
    columns: tuple[Column, ...]
    rows: Sequence[Sequence[Value]]
    """The raw values, each row in the order of `columns`."""
    note: str = ""
    """What a reader must know beside the title."""

    @classmethod
    def of(
        cls, title: str, columns: Sequence[Column | str], rows: Sequence[Sequence[Value]], *, note: str = ""
    ) -> Self:
        """Build a table from rows of values.

        Args:
            title: What the table is about.
            columns: Its columns; a plain name stands for a column without a unit.
            rows: Values in the order of the columns.
            note: What a reader must know beside the title.

        Raises:
            ValueError: A row is not as long as `columns`.
        """
        named = tuple(Column(column) if isinstance(column, str) else column for column in columns)
        for row in rows:
            if len(row) != len(named):
                raise ValueError(f"expected {len(named)} values in a row of {title!r}, got {len(row)}")
        return cls(title=title, columns=named, rows=[list(row) for row in rows], note=note)

    @classmethod
    def of_frame(cls, title: str, frame: "pd.DataFrame", *, note: str = "") -> Self:
        """Build a table from a frame whose columns are headings with their units, without its index."""
        rows = frame.astype(object).where(frame.notna(), None).to_numpy().tolist()
        return cls.of(title, [Column.of(heading) for heading in frame], rows, note=note)

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def headings(self) -> list[str]:
        """Names of the columns with their units."""
        return [column.heading for column in self.columns]

    @property
    def texts(self) -> list[list[str]]:
        """The values as people read them."""
        return [[c.text(value) for c, value in zip(self.columns, row, strict=True)] for row in self.rows]

    def is_numeric(self, index: int) -> bool:
        """Return whether a column has a unit or holds a number."""
        return bool(self.columns[index].unit) or any(isinstance(row[index], int | float) for row in self.rows)

    def markdown(self) -> str:
        """Return the table as GitHub Markdown, without its title; numbers are aligned to the right."""
        return markdown(self.headings, self.texts, [self.is_numeric(index) for index in range(len(self.columns))])

    def print(self, console: "Console") -> None:
        """Print the table; where it is wider than the terminal, in parts that all begin with the columns of names.

        Sentences are wrapped instead.
        """
        from rich.console import Console

        if any(len(text) > SENTENCE for row in self.texts for text in row):
            return console.print(self.rich(), highlight=False)
        wide = Console(file=console.file, force_terminal=console.is_terminal, width=TERMINAL_WIDTH)
        names = self._names()
        parts = [names.copy()]
        for index in range(len(names), len(self.columns)):
            joined = self._part([*parts[-1], index])
            if parts[-1] != names and wide.measure(joined.rich()).maximum > console.width:
                parts.append(names.copy())
            parts[-1].append(index)
        for indices in parts:
            wide.print(self._part(indices, title=self.title * (indices is parts[0])).rich(), highlight=False)

    def _names(self) -> list[int]:
        """Return the indices of the first columns, the fewest that tell all rows apart; the first alone if none do."""
        for n in range(1, len(self.columns)):
            if len({tuple(row[:n]) for row in self.rows}) == len(self.rows):
                return list(range(n))
        return [0]

    def _part(self, indices: Sequence[int], title: str = "") -> "Table":
        """Return the columns with some indices."""
        columns = [self.columns[index] for index in indices]
        return Table.of(title, columns, [[row[index] for index in indices] for row in self.rows])

    def rich(self) -> "RichTable":
        """Return the table for a terminal: headings broken between words, numbers aligned to the right."""
        from textwrap import fill

        from rich.box import SIMPLE_HEAD
        from rich.markup import escape
        from rich.table import Table as RichTable

        printed = RichTable(title=escape(self.title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
        for index, column in enumerate(self.columns):
            widest = max(map(len, (*column.name.split(" "), *(row[index] for row in self.texts))), default=1)
            heading = fill(column.name, widest, break_on_hyphens=False) + (f"\n[{column.unit}]" if column.unit else "")
            side: Literal["left", "right"] = "right" if self.is_numeric(index) else "left"
            printed.add_column(escape(heading), justify=side, no_wrap=widest <= SENTENCE)
        for row in self.texts:
            printed.add_row(*(escape(text) for text in row))
        return printed


def markdown(headings: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool]) -> str:
    """Return a table of texts as GitHub Markdown; `right` tells which columns are aligned to the right."""
    sides = ["---:" if is_right else "---" for is_right in right]
    lines = ([text.replace("|", "\\|") for text in line] for line in (headings, sides, *rows))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def write_frame(stem: Path, frame: "pd.DataFrame") -> list[Path]:
    """Write a frame as `STEM.csv` and `STEM.parquet`, each in one step, and return both paths.

    The frame has the column types that the Parquet file shall have. A failure is a `ToolError`.
    """
    parquet = io.BytesIO()
    frame.to_parquet(parquet, index=False)
    files = {f"{stem.name}.csv": csv_of(frame), f"{stem.name}.parquet": parquet.getvalue()}
    for name, data in files.items():
        write(stem.with_name(name), data)
    return [stem.with_name(name) for name in files]


def csv_of(frame: "pd.DataFrame") -> bytes:
    """Return a frame as a CSV file."""
    text: str = frame.to_csv(index=False, lineterminator="\n")
    return text.encode()
