"""The commands that repeat the paper's experiments, one for each, and one for all."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from voxdepth.tools.options import use_one_thread

from ..experiments.catalogue import CATALOGUE, Entry, duration_text
from .options import Seed

Out = Annotated[Path, typer.Option(metavar="DIR", help="Folder of the results; recordings are shared with `evaluate`.")]
DEFAULT_OUT = Path("evaluation")


class Experiments(TyperGroup):
    """The experiments in the order of the paper; an unknown one is told in one line."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names in the order in which they are listed."""
        return list(self.commands)

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find an experiment, see `click.Group`."""
        if args[0] not in self.commands:
            from ..experiments.runner import find_experiment

            find_experiment(args[0])
        return super().resolve_command(ctx, args)


app = typer.Typer(
    name="experiment",
    cls=Experiments,
    no_args_is_help=True,
    help="Repeat the paper's experiments on rendered sequences, each with its claims and what is found. "
    "Times are of two quiet cores with recordings that exist: missing ones are made first, at 0.1 to 0.5 s a frame. "
    "Each writes table.csv, figure.png and result.json into DIR/NAME. docs/results.md has all results.",
)


def _run(names: Iterable[str], out: Path, given: dict[str, Any], *, resume: bool = False) -> None:
    """Run experiments one after the other; `resume` takes the answers of those that are finished."""
    use_one_thread()

    import sys

    import cv2
    from rich.console import Console

    from ..experiments.runner import answer, claim_table, find_experiment, kept, show

    cv2.setNumThreads(1)
    console, command = Console(), " ".join(["voxdepth", *sys.argv[1:]])
    experiments = {name: find_experiment(name).with_options(**given, out=out) for name in names}
    claims = []
    for name, experiment in experiments.items():
        with console.status("") as status:
            watched = experiment.with_options(
                report=lambda what, name=name, status=status: status.update(f"{name}: {what}")
            )
            record = (kept(name, watched) if resume else None) or answer(name, watched, command)
        show(record, out / name, console)
        claims += [(name, claim) for claim in record.claims]
    if len(experiments) > 1:
        claim_table(claims).print(console)


def _command(name: str, entry: Entry) -> Callable[..., None]:
    """Return the command of one experiment, whose help is what the paper claims."""

    def experiment(
        sequences: Annotated[
            str | None,
            typer.Option(
                metavar="A,B,C", help="Shipped sequences. Default: what the experiment needs.", hidden=not entry.images
            ),
        ] = None,
        frames: Annotated[
            int | None, typer.Option(min=1, help="How many of the first frames of each.", hidden=not entry.images)
        ] = None,
        width: Annotated[
            int | None,
            typer.Option(metavar="PX", help="Width of the images; the height follows.", hidden=not entry.images),
        ] = None,
        data: Annotated[list[Path] | None, typer.Option(metavar="PATH", help=entry.data, hidden=not entry.data)] = None,
        seed: Seed = None,
        out: Out = DEFAULT_OUT,
    ) -> None:
        chosen = None if sequences is None else tuple(dict.fromkeys(sequences.replace(" ", "").split(",")))
        if data and not entry.data:
            from ..errors import ScenarioError

            raise ScenarioError(f"{name} reads no recordings: leave out --data")
        given = {"sequences": chosen, "frames": frames, "width_px": width, "seed": seed}
        _run([name], out, given | {"data": tuple(data) if data else None})

    experiment.__doc__ = f"{entry.label}: {entry.claim}; {duration_text(entry.minutes)}."
    return experiment


for _name, _entry in CATALOGUE.items():
    app.command(name=_name)(_command(_name, _entry))


@app.command(name="all")
def all_(seed: Seed = None, out: Out = DEFAULT_OUT) -> None:
    """All of them in the order of the paper, with their defaults; what an interrupted run finished is not repeated."""
    _run(CATALOGUE, out, {"seed": seed}, resume=True)


all_.__doc__ = f"{all_.__doc__} {duration_text(sum(entry.minutes for entry in CATALOGUE.values()))}."
