"""Runs experiments one after the other, each into a folder of its own."""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from voxdepth.errors import no_such
from voxdepth.tools.files import write
from voxdepth.tools.provenance import Provenance
from voxdepth.tools.table import Table

from ..errors import ScenarioError
from ..provenance import SIMULATION
from .artefacts import artefacts
from .collisions import collide
from .confidence import confidence
from .experiment import Claim, Experiment, ExperimentContext, Findings, verdict
from .frame_rate import fps
from .quality import quality

if TYPE_CHECKING:
    from rich.console import Console

ALL, INDEX = "all", "index.md"
PAPER_EXPERIMENTS = (quality, fps, collide)
"""Questions of the paper, in its order."""
EXPERIMENTS = {one.name: one for one in (*PAPER_EXPERIMENTS, artefacts, confidence)}
"""All experiments by name; the last two are about the simulator and about the correctors."""


@dataclass(frozen=True, eq=False)
class ExperimentReport:
    """The findings of an experiment with all that is needed to repeat it."""

    experiment: Experiment
    context: ExperimentContext
    command: str
    findings: Findings

    @property
    def tables(self) -> list[Table]:
        """The tables of the findings as people read them."""
        found = self.findings.tables.items()
        return [Table.of_frame(f"{self.experiment.name}: {name}", frame, name=name) for name, frame in found]

    def write(self) -> None:
        """Write the tables with their notes, the figure and `result.json` below `out`; a failure is a `ToolError`."""
        context, findings = self.context, self.findings
        result = {
            "name": self.experiment.name,
            "question": self.experiment.question,
            "command": self.command,
            **{name: getattr(context, name) for name in ("sequences", "frames", "width_px")},
            "seed": context.seed or 0,
            "data": list(map(str, context.data)),
            "provenance": vars(Provenance.here(SIMULATION)),
            "tables": [table.as_json() for table in self.tables],
            "claims": list(map(asdict, findings.claims)),
            "notes": findings.notes,
        }
        page = [f"{verdict(findings.claims)}\n\n`{self.command}`\n"]
        page += [f"**{table.title}**\n\n{table.markdown()}" for table in self.tables]
        page += [f"{note}\n" for note in findings.notes]
        files = {
            **{f"{table.name}.csv": table.csv() for table in self.tables},
            **findings.files,
            "table.md": "\n".join(page).encode(),
            "figure.png": findings.figure,
            "result.json": f"{json.dumps(result, indent=1)}\n".encode(),
        }
        for name, content in files.items():
            write(context.out / self.experiment.name / name, content)

    def print(self, console: "Console") -> None:
        """Print the question, the verdict, the tables, the claims and the notes."""
        context, findings = self.context, self.findings
        width = "" if context.width_px is None else f" of {context.width_px} pixels width"
        frames = f"{context.frames} frames{width} of {', '.join(context.sequences)}; seed {context.seed or 0}"
        if not context.sequences:
            frames = f"missions with {context.frames} seeds"
        claims = [
            f"paper: {claim.paper}\nhere:  {claim.found}\n       ({claim.verdict}; it agrees if {claim.agrees_if})"
            for claim in findings.claims
        ]
        remarks = [*claims, *(f"note:  {note}" for note in findings.notes), ""]
        plain: dict[str, Any] = {"sep": "\n", "soft_wrap": True, "highlight": False, "markup": False}
        console.print(f"{self.experiment.name}: {self.experiment.question}", style="bold", **plain)
        console.print(verdict(findings.claims), frames, **plain)
        for table in self.tables:
            table.print(console)
        console.print(*remarks, **plain)


def write_index(out: Path) -> Table:
    """Write the page of all claims of the paper whose experiments have results in a folder, and return its table."""
    rows, links = [], []
    for name in EXPERIMENTS:
        file = out / name / "result.json"
        if file.is_file():
            result = json.loads(file.read_text())
            links.append(f"- [{name}]({name}/table.md), [figure]({name}/figure.png): {result['question']}")
            rows += [(name, Claim(**claim)) for claim in result["claims"]]
    cells = [(name, claim.paper, claim.found, claim.verdict, claim.agrees_if) for name, claim in rows]
    table = Table.of("The paper's claims", ("experiment", "paper", "here", "verdict", "it agrees if"), cells)
    head = f"# {table.title}\n\n{verdict([claim for _, claim in rows])}\n"
    write(out / INDEX, "\n".join([head, table.markdown(), *links, ""]).encode())
    return table


def find_experiments(names: Sequence[str]) -> list[Experiment]:
    """Experiments by name, `all` for every one of the paper's; a wrong name is a `ScenarioError`."""
    paper = [experiment.name for experiment in PAPER_EXPERIMENTS]
    wanted = [found for name in names for found in (paper if name == ALL else [name])]
    for name in wanted:
        if name not in EXPERIMENTS:
            raise ScenarioError(no_such("experiment", name, [*EXPERIMENTS, ALL]))
        if wanted.count(name) > 1:
            raise ScenarioError(f"the experiment {name!r} is named twice: once is enough")
    return [EXPERIMENTS[name] for name in wanted]


def run(experiment: Experiment, context: ExperimentContext, command: str) -> ExperimentReport:
    """Answer one question and write the results; see `Experiment.answer` for what it raises."""
    report = ExperimentReport(experiment, context, command, experiment.answer(context))
    report.write()
    return report
