"""Tables as Markdown, to be pasted into a document."""

from .result import Column, Result, Table, Value, text_of


def markdown_of(result: Result, command: str) -> str:
    """All tables of a result below the command that made them."""
    return "\n".join([f"`{command}`\n", *(f"**{table.title}**\n\n{_rows(table)}" for table in result.tables)])


def _rows(table: Table) -> str:
    """Titles, a line below them that says where numbers stand, and the rows; ends with an empty line's worth."""
    titles = [column.title for column in table.columns]
    sides = ["---:" if _has_numbers(table, place) else "---" for place in range(len(titles))]
    rows = [[_cell(value, column) for value, column in zip(row, table.columns, strict=True)] for row in table.rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in (titles, sides, *rows))


def _has_numbers(table: Table, place: int) -> bool:
    return any(isinstance(row[place], int | float) for row in table.rows)


def _cell(value: Value, column: Column) -> str:
    return text_of(value, column).replace("|", "\\|")
