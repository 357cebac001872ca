"""Runs an experiment, writes its results into a folder of its own, and prints them."""

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

from voxdepth.errors import no_such
from voxdepth.tools.files import write
from voxdepth.tools.provenance import Provenance
from voxdepth.tools.table import Table, csv_of

from ..errors import ScenarioError
from ..provenance import SIMULATION
from .artefacts import artefacts
from .confidence import confidence
from .experiment import Experiment, ExperimentContext, Findings
from .quality import quality

if TYPE_CHECKING:
    from rich.console import Console

EXPERIMENTS = {one.name: one for one in (quality, artefacts, confidence)}
"""All experiments by name: about the paper, about the simulator and about the correctors."""


def find_experiments(names: Sequence[str]) -> list[Experiment]:
    """Experiments by name, each once; a wrong name is a `ScenarioError`."""
    for name in names:
        if name not in EXPERIMENTS:
            raise ScenarioError(no_such("experiment", name, EXPERIMENTS))
    return [EXPERIMENTS[name] for name in dict.fromkeys(names)]


def run(experiment: Experiment, context: ExperimentContext, command: str) -> Findings:
    """Answer one question and write the results below `out`; a file that cannot be written is a `ToolError`.

    See `Experiment.answer` for what else it raises.
    """
    findings = experiment.answer(context)
    result = {
        "name": experiment.name,
        "question": experiment.question,
        "command": command,
        "sequences": context.sequences,
        "frames": context.frames,
        "width_px": context.width_px,
        "seed": context.seed or 0,
        "data": list(map(str, context.data)),
        "provenance": vars(Provenance.here(SIMULATION)),
        "notes": findings.notes,
    }
    files = {
        "table.csv": csv_of(findings.table),
        "figure.png": findings.figure,
        "result.json": f"{json.dumps(result, indent=1)}\n".encode(),
        **findings.files,
    }
    for name, content in files.items():
        write(context.out / experiment.name / name, content)
    return findings


def print_findings(console: "Console", experiment: Experiment, findings: Findings) -> None:
    """Print the question, the table and the notes."""
    Table.of_frame(f"{experiment.name}: {experiment.question}", findings.table).print(console)
    for note in findings.notes:
        console.print(note, markup=False, highlight=False, soft_wrap=True)
