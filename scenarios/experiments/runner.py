"""Runs an experiment, writes its results into a folder of its own, and prints them."""

import json
from typing import TYPE_CHECKING

from voxdepth.errors import no_such
from voxdepth.tools.files import write
from voxdepth.tools.provenance import Provenance
from voxdepth.tools.table import Table, csv_of

from ..errors import ScenarioError
from ..provenance import SIMULATION
from .experiment import Experiment
from .quality import QUALITY

if TYPE_CHECKING:
    from rich.console import Console

EXPERIMENTS = {one.name: one for one in (QUALITY,)}


def find_experiment(name: str) -> Experiment:
    """The experiment of a name; a wrong name is a `ScenarioError`."""
    if name not in EXPERIMENTS:
        raise ScenarioError(no_such("experiment", name, EXPERIMENTS))
    return EXPERIMENTS[name]


def run(experiment: Experiment, command: str, console: "Console") -> None:
    """Answer a question, write the results below `out` and print them; a file that cannot be written is a `ToolError`.

    See `Experiment.answer` for what else it raises.
    """
    findings = experiment.answer(experiment)
    result = {
        "name": experiment.name,
        "question": experiment.question,
        "command": command,
        **{name: getattr(experiment, name) for name in ("sequences", "frames", "width_px", "seed")},
        "provenance": vars(Provenance.here(SIMULATION)),
        "notes": findings.notes,
    }
    table = Table.of_frame(f"{experiment.name}: {experiment.question}", findings.table)
    files = {
        "table.csv": csv_of(findings.table),
        "result.json": f"{json.dumps(result, indent=1)}\n".encode(),
        **findings.files,
    }
    for name, content in files.items():
        write(experiment.out / experiment.name / name, content)
    table.print(console)
    for note in findings.notes:
        console.print(note, markup=False, highlight=False, soft_wrap=True)
    console.print(f"{', '.join(files)} are in {experiment.out / experiment.name}", markup=False, soft_wrap=True)
