"""Runs experiments, writes the results of each into a folder of its own, and prints them."""

from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

from voxdepth.errors import no_such
from voxdepth.tools.files import write
from voxdepth.tools.results.provenance import Provenance
from voxdepth.tools.results.store import Records
from voxdepth.tools.results.table import Table, csv_of

from ..errors import ScenarioError
from ..provenance import SIMULATION
from .catalogue import CATALOGUE
from .experiment import Claim, Experiment, summary

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True, kw_only=True)
class ExperimentRecord:
    """What is kept of an experiment beside its table and figure."""

    name: str
    label: str
    """Section, table or figure of the paper."""
    question: str
    command: str
    options: dict[str, Any]
    """The sequences, frames, width, seed and data by which it was answered."""
    provenance: Provenance
    claims: tuple[Claim, ...]
    notes: tuple[str, ...]


RECORDS = Records(ExperimentRecord)


def find_experiment(name: str) -> Experiment:
    """Return the experiment of a name; a wrong name is a `ScenarioError`."""
    if name not in CATALOGUE:
        raise ScenarioError(no_such("experiment", name, CATALOGUE))
    found: Experiment = import_module(f"{__package__}.{name}").EXPERIMENT
    return found


def run(name: str, experiment: Experiment, command: str, console: "Console") -> tuple[Claim, ...]:
    """Answer a question, write the results below `out` and print them; a file that cannot be written is a `ToolError`.

    See `Experiment.answer` for what else it raises.

    Args:
        name: Name of the experiment in the catalogue, and of the folder of its results.
        experiment: The question, with the data and options by which it is answered.
        command: The command line, which is kept with the results.
        console: Where the results are printed.
    """
    findings = experiment.answer(experiment)
    claims = experiment.claims(findings.table)
    record = ExperimentRecord(
        name=name,
        label=CATALOGUE[name].label,
        question=experiment.question,
        command=command,
        options={key: getattr(experiment, key) for key in ("sequences", "frames", "width_px", "seed", "data")},
        provenance=Provenance.here(SIMULATION),
        claims=claims,
        notes=experiment.notes,
    )
    files = {"table.csv": csv_of(findings.table), "result.json": RECORDS.encode(record)}
    if findings.figure is not None:
        files["figure.png"] = findings.figure
    for file, content in files.items():
        write(experiment.out / name / file, content)
    plain: dict[str, Any] = {"sep": "\n", "markup": False, "highlight": False, "soft_wrap": True}
    console.print(f"{name}, {CATALOGUE[name].label}: {experiment.question}", style="bold", **plain)
    Table.of_frame("", findings.table).print(console)
    folder = experiment.out / name
    lines = (*map(str, claims), *(f"note:  {note}" for note in experiment.notes), f"{', '.join(files)} are in {folder}")
    console.print(*lines, **plain)
    return claims


def claim_table(found: Sequence[tuple[str, Claim]]) -> Table:
    """Return the verdicts on the claims of several experiments, each with the name of its experiment."""
    rows = [(name, claim.paper, claim.found, claim.verdict) for name, claim in found]
    return Table.of(summary([claim for _, claim in found]), ("experiment", "the paper claims", "here", "verdict"), rows)
