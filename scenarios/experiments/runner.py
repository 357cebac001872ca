"""Answers the questions of experiments, keeps each answer in a folder of its own, and prints it."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from voxdepth.errors import no_such
from voxdepth.tools.files import as_tool_error, write
from voxdepth.tools.results.provenance import EVALUATION_SOURCES, Provenance, code_digest
from voxdepth.tools.results.store import Records
from voxdepth.tools.results.table import Table, csv_of

from ..errors import ScenarioError
from ..provenance import FLIGHT_SOURCES, SENSOR_SOURCES, SIMULATION
from .catalogue import CATALOGUE
from .experiment import Claim, Experiment, summary

if TYPE_CHECKING:
    from rich.console import Console


EXPERIMENT_SOURCES = (
    *EVALUATION_SOURCES,
    *FLIGHT_SOURCES,
    *SENSOR_SOURCES,
    ("scenarios", "experiments/**/*.py"),
    ("scenarios", "data/*/*.toml"),
    ("scenarios", "data/networks/*.onnx"),
)
"""Packages and the patterns of those of their files that determine an answer."""
TABLE, FIGURE, RESULT = "table.csv", "figure.png", "result.json"


@dataclass(frozen=True, kw_only=True)
class ExperimentRecord:
    """What is kept of an answer beside its table and figure."""

    name: str
    label: str
    """Section, table or figure of the paper."""
    question: str
    command: str
    options: dict[str, Any]
    """The sequences, frames, width, seed and data by which it was answered."""
    provenance: Provenance
    code: str
    """Digest of `EXPERIMENT_SOURCES`."""
    claims: tuple[Claim, ...]
    notes: tuple[str, ...]


RECORDS = Records(ExperimentRecord)


def find_experiment(name: str) -> Experiment:
    """Return the experiment of a name; a wrong name is a `ScenarioError`."""
    if name not in CATALOGUE:
        raise ScenarioError(no_such("experiment", name, CATALOGUE))
    found: Experiment = import_module(f"{__package__}.{name}").EXPERIMENT
    return found


def answer(name: str, experiment: Experiment, command: str) -> ExperimentRecord:
    """Answer a question, and write the results below `out`; a file that cannot be written is a `ToolError`.

    See `Experiment.answer` for what else it raises.

    Args:
        name: Name of the experiment in the catalogue, and of the folder of its results.
        experiment: The question, with the data and options by which it is answered.
        command: The command line, which is kept with the results.
    """
    findings = experiment.answer(experiment)
    record = ExperimentRecord(
        name=name,
        label=CATALOGUE[name].label,
        question=experiment.question,
        command=command,
        options=_options(experiment),
        provenance=Provenance.here(SIMULATION),
        code=code_digest(EXPERIMENT_SOURCES),
        claims=experiment.claims(findings.table),
        notes=experiment.notes,
    )
    files = {TABLE: csv_of(findings.table), RESULT: RECORDS.encode(record)}
    if findings.figure is not None:
        files = {FIGURE: findings.figure, **files}
    for file, content in files.items():  # The last one is there if all are.
        write(experiment.out / name / file, content)
    return record


def kept(name: str, experiment: Experiment) -> ExperimentRecord | None:
    """Return the answer that an interrupted run left, if it was made here by this code with the same options.

    One that read data of the user is none: they may have changed.
    """
    path = experiment.out / name / RESULT
    with as_tool_error(f"cannot read {path}"), suppress(FileNotFoundError, ValueError):
        record = RECORDS.decode(path.read_bytes())  # It may be damaged, or of another version.
        here = Provenance.here(SIMULATION)
        same = (record.options, record.code) == (_options(experiment), code_digest(EXPERIMENT_SOURCES))
        versions = record.provenance.versions, record.provenance.machine, record.provenance.python
        if same and versions == (here.versions, here.machine, here.python) and not experiment.data:
            return record
    return None


def show(record: ExperimentRecord, folder: Path, console: "Console") -> None:
    """Print an answer whose files are in a folder."""
    plain: dict[str, Any] = {"sep": "\n", "markup": False, "highlight": False, "soft_wrap": True}
    console.print(f"{record.name}, {record.label}: {record.question}", style="bold", **plain)
    Table.of_frame("", pd.read_csv(folder / TABLE)).print(console)
    files = [file for file in (TABLE, FIGURE, RESULT) if (folder / file).exists()]
    notes = [f"note:  {note}" for note in record.notes]
    console.print(*map(str, record.claims), *notes, f"{', '.join(files)} are in {folder}", **plain)


def _options(experiment: Experiment) -> dict[str, Any]:
    numbers = {key: getattr(experiment, key) for key in ("frames", "width_px", "seed")}
    return {key: list(map(str, getattr(experiment, key))) for key in ("sequences", "data")} | numbers


def claim_table(found: Sequence[tuple[str, Claim]]) -> Table:
    """Return the verdicts on the claims of several experiments, each with the name of its experiment."""
    headings = ("experiment", "the paper claims", "here", "it agrees if", "verdict")
    rows = [(name, claim.paper, claim.found, claim.agrees_if, claim.verdict) for name, claim in found]
    return Table.of(summary([claim for _, claim in found]), headings, rows)
