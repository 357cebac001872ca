"""Running experiments one after the other, each into a folder of its own."""

import csv
import io
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from voxdepth.model import Model

from ..benchmark.machine import Machine
from ..errors import ScenarioError
from ..files import write
from .experiment import Experiment
from .markdown import markdown_of
from .result import Claim, Result, Table
from .stage import Stage

FIGURE, REPORT, MARKDOWN = "figure.png", "result.json", "table.md"


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """What the user asked for; None leaves it to each experiment."""

    out: Path
    sequences: tuple[str, ...] | None = None
    frames: int | None = None
    width_px: int | None = None
    seed: int | None = None
    command: str = ""
    """As it was typed, for the record."""


class Report(Model):
    """A result with all that is needed to make it again."""

    name: str
    question: str
    command: str
    sequences: tuple[str, ...]
    frames: int
    width_px: int | None
    """Of the images; None for that of each sequence."""
    seed: int
    machine: Machine
    result: Result


def staged(experiment: Experiment, wishes: Wishes, tell: Callable[[str], None]) -> Stage:
    """What an experiment works on.

    Raises:
        ScenarioError: There are too few frames for it, or there is no such sequence or width.
    """
    scope = experiment.scope
    stage = Stage(
        out=wishes.out,
        sequences=scope.sequences if wishes.sequences is None else wishes.sequences,
        frames=scope.frames if wishes.frames is None else wishes.frames,
        width_px=scope.width_px if wishes.width_px is None else wishes.width_px,
        seed=wishes.seed,
        tell=lambda what: tell(f"{experiment.name}: {what}"),
    )
    if stage.frames < scope.least_frames:
        raise ScenarioError(
            f"{experiment.name} needs at least {scope.least_frames} frames of each sequence, got --frames "
            f"{stage.frames}: ask for more"
        )
    for name in stage.sequences:
        if stage.sequences.count(name) > 1:
            raise ScenarioError(f"--sequences names {name!r} twice: once is enough")
        stage.planned(name)
    return stage


def run(experiments: Sequence[Experiment], wishes: Wishes, tell: Callable[[str], None]) -> Iterator[Report]:
    """Run experiments in order; each is written when it is given.

    Raises:
        ScenarioError: Something asked for is impossible, which is found before anything is run, or a file cannot be
            written.
        SimError, VoxDepthError: A sequence cannot be had.
    """
    stages = [staged(experiment, wishes, tell) for experiment in experiments]
    for experiment, stage in zip(experiments, stages, strict=True):
        yield _reported(experiment, stage, wishes)


def _reported(experiment: Experiment, stage: Stage, wishes: Wishes) -> Report:
    machine = Machine.here()
    result = experiment.run(stage)
    report = Report(
        name=experiment.name,
        question=experiment.question,
        command=wishes.command,
        sequences=stage.sequences,
        frames=stage.frames,
        width_px=stage.width_px,
        seed=0 if wishes.seed is None else wishes.seed,
        machine=machine,
        result=result,
    )
    folder = wishes.out / experiment.name
    for table in result.tables:
        write(folder / f"{table.name}.csv", csv_of(table))
    write(folder / MARKDOWN, markdown_of(result, wishes.command).encode())
    write(folder / FIGURE, result.figure)
    for name, picture in result.pictures.items():
        write(folder / f"{name}.png", picture)
    write(folder / REPORT, f"{report.model_dump_json(indent=1)}\n".encode())
    return report


def csv_of(table: Table) -> bytes:
    """A table as text: titles with units, then the rows; what is not known is empty."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(column.title for column in table.columns)
    writer.writerows(table.rows)
    return text.getvalue().encode()


def verdict(claim: Claim) -> str:
    """In one word or two."""
    return {True: "agrees", False: "differs", None: "open"}[claim.holds]
