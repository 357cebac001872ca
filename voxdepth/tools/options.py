"""What several commands share: options, the parsing of their texts, what they need, and the progress bar."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated

import typer

from .errors import ToolError

if TYPE_CHECKING:
    from rich.console import Console

DEFAULT_CORRECTOR = "temporal"
"""The same word as in the registry, which is not imported for `--help`."""
NAMES_HELP = "voxdepth is VoxDepth (the paper), and temporal (ours) is the default"
"""What the names of the two methods mean that are no baselines."""
CORRECTOR_HELP = (
    rf"Depth corrector by name, perhaps with a setting as in temporal\[fill=all]: {NAMES_HELP}. Your own as "
    "module:factory."
)
"""Without the backslash the setting would be taken for the markup of Rich."""

DepthTopic = Annotated[
    str | None, typer.Option(metavar="TOPIC", help="Topic of the depth in a bag. Default: the only one.")
]
GrayTopic = Annotated[
    str | None,
    typer.Option(metavar="TOPIC", help="Topic of the gray image in a bag. Default: the only one of the same camera."),
]
Within = Annotated[
    float,
    typer.Option(min=0, metavar="MS", help="Largest difference of the times of a depth and a gray image of one frame."),
]
"""For sequences whose images are paired by time."""
UnitsPerM = Annotated[
    float | None,
    typer.Option(
        metavar="N",
        help="Steps of a metre in the depth: 1000 for millimetres, 1 for metres. Default: what calibration.toml, the "
        "data or their format say.",
    ),
]
Start = Annotated[int, typer.Option(min=0, metavar="N", help="Number of the first frame, which is 0 in a recording.")]
Baseline = Annotated[
    float | None,
    typer.Option(
        "--baseline", metavar="M", help="Distance of the stereo cameras in metres. Default: what PATH states."
    ),
]


def parsed_size(text: str) -> tuple[int, int]:
    """Return width and height of an image size."""
    width, cross, height = text.partition("x")
    if not (cross and width.isdecimal() and height.isdecimal()):
        raise ToolError(f"--size must look like 160x120, got {text!r}")
    return int(width), int(height)


def require_installed(package: str) -> None:
    """Raise a `ModuleNotFoundError` at once where an extra is missing, of which the command line names the remedy."""
    if find_spec(package) is None:
        raise ModuleNotFoundError(f"No module named {package!r}", name=package)


def use_one_thread() -> None:
    """Keep numerical libraries on one thread, here if they are not imported yet, and in processes that start later.

    Sums may depend on the number of threads. OpenCV and the renderer have settings of their own.
    """
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[variable] = "1"


@contextmanager
def counter(console: "Console", activity: str, total: int, unit: str = "frames") -> Iterator[Callable[..., None]]:
    """Show a progress bar and give the function that takes the number of finished units and the activity.

    Args:
        console: Where the bar is shown.
        activity: What is done at first, in words.
        total: Number of units.
        unit: Name of the units.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    activity_column = TextColumn("{task.description}")
    columns = (BarColumn(), MofNCompleteColumn(), TextColumn(unit), TimeRemainingColumn(), activity_column)
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(activity, total=total)
        yield lambda finished, now=activity: bar.update(task, completed=finished, description=now)
