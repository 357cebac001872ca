"""The progress bar of the commands that work through frames or results."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console


@contextmanager
def counter(console: "Console", activity: str, total: int, unit: str = "frames") -> Iterator[Callable[..., None]]:
    """Show a progress bar and give the function that takes the number of finished units and the activity."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn(unit),
        TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(activity, total=total)
        yield lambda finished, now=activity: bar.update(task, completed=finished, description=now)
