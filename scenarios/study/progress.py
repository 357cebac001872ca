"""What a person sees while a study is flown: a table that lives on a terminal, and lines now and then elsewhere."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.table import Table

from .tally import Tally

LINE_EVERY_S = 30.0


@dataclass(frozen=True, kw_only=True)
class Pace:
    """Speed of this call."""

    elapsed_s: float
    left_s: float | None


class Show(Protocol):
    """Is told after every run."""

    def update(self, tally: Tally, pace: Pace) -> None:
        """Show how far it is."""
        ...


class LiveShow:
    """A table that is drawn anew."""

    def __init__(self, live: Live) -> None:
        self._live = live

    def update(self, tally: Tally, pace: Pace) -> None:
        """See `Show`."""
        self._live.update(as_table(tally, pace))


class LineShow:
    """A line for the first and the last run, and every half minute."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._next_s = 0.0

    def update(self, tally: Tally, pace: Pace) -> None:
        """See `Show`."""
        if pace.elapsed_s >= self._next_s or tally.done + len(tally.failed) == tally.total:
            self._next_s = pace.elapsed_s + LINE_EVERY_S
            self._console.print(as_line(tally, pace), soft_wrap=True)


@contextmanager
def shown(console: Console) -> Iterator[Show]:
    """What suits the console."""
    if not console.is_terminal:
        yield LineShow(console)
        return
    with Live(console=console, refresh_per_second=2) as live:
        yield LiveShow(live)


def as_line(tally: Tally, pace: Pace) -> str:
    """All in one line."""
    rows = ", ".join(f"{name} {row.collisions} of {row.done} collided" for name, row in tally.rows.items() if row.done)
    clock = time.strftime("%H:%M:%S")
    return f"{clock} {_head(tally, pace)}" + (f"; {rows}" if rows else "")


def as_table(tally: Tally, pace: Pace | None = None) -> Table:
    """One row for each arm in each scenario at each theta."""
    title = _head(tally, pace)
    table = Table("arm", "runs", "collisions", "collision ratio", "time of a run", title=title, title_justify="left")
    for name, row in tally.rows.items():
        ratio = f"{row.collisions / row.done:.2f}" if row.done else "-"
        mean_s = f"{row.mean_wall_s:.1f} s" if row.mean_wall_s is not None else "-"
        table.add_row(name, f"{row.done} of {row.cells}", str(row.collisions), ratio, mean_s)
    return table


def _head(tally: Tally, pace: Pace | None) -> str:
    parts = [f"{tally.done} of {tally.total} runs"]
    if pace is not None and tally.flown and pace.elapsed_s > 0:
        parts.append(f"{3600 * tally.flown / pace.elapsed_s:.0f} runs per hour")
    if pace is not None and pace.left_s is not None:
        parts.append(f"{duration(pace.left_s)} left")
    if tally.failed:
        parts.append(f"{len(tally.failed)} errors")
    return ", ".join(parts)


def duration(seconds: float) -> str:
    """A time as people say it."""
    minutes = round(seconds / 60)
    return f"{minutes // 60} h {minutes % 60:02d} min" if minutes >= 60 else f"{minutes} min"
