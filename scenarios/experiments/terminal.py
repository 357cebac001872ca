"""What a person reads in the terminal: the tables, and the paper's claims beside what was found."""

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Printed

from .result import Table, text_of
from .runner import Report, verdict

WIDEST = 400
"""Characters in a line of a table."""


def print_report(console: Console, report: Report) -> None:
    """Question, tables, claims and notes."""
    console.print(f"[bold]{report.name}[/bold]: {escape(report.question)}", soft_wrap=True, highlight=False)
    console.print(escape(_scope(report)), soft_wrap=True, highlight=False)
    for table in report.result.tables:
        _unsqueezed(console).print(_printed(table), highlight=False)
    for claim in report.result.claims:
        console.print(escape(f"paper: {claim.paper}"), soft_wrap=True, highlight=False)
        console.print(escape(f"here:  {claim.found} ({verdict(claim)})"), soft_wrap=True, highlight=False)
    for note in report.result.notes:
        console.print(escape(f"note:  {note}"), soft_wrap=True, highlight=False)
    console.print()


def _unsqueezed(console: Console) -> Console:
    """The same output for a table that may be wider than the terminal: squeezing it would cut its numbers."""
    return Console(file=console.file, force_terminal=console.is_terminal, width=WIDEST)


def _scope(report: Report) -> str:
    width = "" if report.width_px is None else f" of {report.width_px} pixels width"
    return f"{report.frames} frames{width} of {', '.join(report.sequences)}; seed {report.seed}"


def _printed(table: Table) -> Printed:
    printed = Printed(title=escape(table.title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for place, column in enumerate(table.columns):
        is_text = all(isinstance(row[place], str) for row in table.rows)
        heading = column.name.replace(" ", "\n") + (f"\n[{column.unit}]" if column.unit else "")
        printed.add_column(escape(heading), justify="left" if is_text else "right", no_wrap=True)
    for row in table.rows:
        printed.add_row(*(escape(text_of(value, column)) for value, column in zip(row, table.columns, strict=True)))
    return printed
