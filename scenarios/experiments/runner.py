"""Runs experiments one after the other, each into a folder of its own."""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from voxdepth.tools.files import write
from voxdepth.tools.provenance import Provenance
from voxdepth.tools.table import Table, Value

from ..errors import ScenarioError
from ..results.provenance import SIMULATION
from .ablation import ABLATION
from .artefacts import ARTEFACTS
from .collisions import COLLISIONS
from .components import COMPONENTS
from .confidence import CONFIDENCE
from .default import DEFAULT_METHOD
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .frame_rate import FRAME_RATE
from .frame_size import FRAME_SIZE
from .inpainting import INPAINTING
from .occlusion import OCCLUSION
from .optical_flow import OPTICAL_FLOW
from .quality import QUALITY
from .steps import STEPS
from .switches import STATE_SWITCHES
from .window import WINDOW

if TYPE_CHECKING:
    from rich.console import Console

FIGURE, RESULT, MARKDOWN = "figure.png", "result.json", "table.md"
ALL = "all"
PAPER_EXPERIMENTS = (
    OCCLUSION, FRAME_SIZE, INPAINTING, OPTICAL_FLOW, STEPS, QUALITY, FRAME_RATE, COMPONENTS, WINDOW, STATE_SWITCHES
)  # fmt: skip
"""Questions of the paper, in its order."""
EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (*PAPER_EXPERIMENTS, COLLISIONS, DEFAULT_METHOD, ABLATION, ARTEFACTS, CONFIDENCE)
}
"""All experiments by name. `collide` is the paper's, too, but flies for many minutes; the last four are not about the
paper, but about the correctors and the simulator."""
INDEX = "index.md"


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of the user; None leaves a choice to each experiment."""

    out: Path
    sequences: tuple[str, ...] | None = None
    data: tuple[Path, ...] = ()
    frames: int | None = None
    width_px: int | None = None
    seed: int | None = None
    command: str = ""
    """The command line, which is stored beside the results."""


@dataclass(frozen=True, eq=False)
class ExperimentReport:
    """The findings of an experiment with all that is needed to repeat it."""

    experiment: Experiment
    context: ExperimentContext
    command: str
    provenance: Provenance
    findings: Findings

    def write(self) -> None:
        """Write the tables with their notes, the figure and `result.json` into the folder of the experiment.

        Raises:
            ToolError: A file cannot be written.
        """
        context, findings = self.context, self.findings
        folder = context.out / self.experiment.name
        parts = [f"**{table.title}**\n\n{table.markdown()}" for table in findings.tables]
        parts += [f"{note}\n" for note in findings.notes]
        for table in findings.tables:
            write(folder / f"{table.name}.csv", table.csv())
        write(folder / MARKDOWN, "\n".join([f"`{self.command}`\n", *parts]).encode())
        write(folder / FIGURE, findings.figure)
        for name, content in findings.files.items():
            write(folder / name, content)
        result = {
            "name": self.experiment.name,
            "question": self.experiment.question,
            "command": self.command,
            "sequences": context.sequences,
            "data": [str(folder) for folder in context.data],
            "frames": context.frames,
            "width_px": context.width_px,
            "seed": context.seed or 0,
            "provenance": self.provenance.model_dump(mode="json"),
            "tables": [table.as_json() for table in findings.tables],
            "claims": [asdict(claim) for claim in findings.claims],
            "notes": findings.notes,
        }
        write(folder / RESULT, f"{json.dumps(result, indent=1)}\n".encode())

    def print(self, console: "Console") -> None:
        """Print the question, the tables, the claims and the notes."""
        from rich.markup import escape

        context, findings = self.context, self.findings
        width = "" if context.width_px is None else f" of {context.width_px} pixels width"
        frames = f"{context.frames} frames{width} of {', '.join(context.sequences)}; seed {context.seed or 0}"
        if not context.sequences:
            frames = f"missions with {context.frames} seeds"
        remarks = [f"note:  {note}" for note in findings.notes]
        for claim in reversed(findings.claims):
            remarks = [f"paper: {claim.paper}", f"here:  {claim.found} ({claim.verdict})", *remarks]
        question = f"[bold]{self.experiment.name}[/bold]: {escape(self.experiment.question)}"
        console.print(question, escape(frames), sep="\n", soft_wrap=True, highlight=False)
        for table in findings.tables:
            table.print(console)
        console.print(*map(escape, remarks), "", sep="\n", soft_wrap=True, highlight=False)


def write_index(out: Path) -> Table:
    """Write the page of all claims of the paper whose experiments have results in a folder, and return its table.

    Raises:
        ToolError: The page cannot be written.
    """
    rows: list[Sequence[Value]] = []
    links: list[str] = []
    for name in EXPERIMENTS:
        file = out / name / RESULT
        if file.is_file():
            result = json.loads(file.read_text())
            links.append(f"- [{name}]({name}/{MARKDOWN}), [figure]({name}/{FIGURE}): {result['question']}")
            claims = [Claim(**claim) for claim in result["claims"]]
            rows += [(name, claim.paper, claim.found, claim.verdict) for claim in claims]
    table = Table.of("The paper's claims", ("experiment", "paper", "here", "verdict"), rows)
    write(out / INDEX, "\n".join([f"# {table.title}\n", table.markdown(), *links, ""]).encode())
    return table


def find_experiments(names: Sequence[str]) -> list[Experiment]:
    """Experiments by name, in the order of the names; `all` stands for every one of the paper's.

    Raises:
        ScenarioError: No experiment has that name, or a name appears twice.
    """
    paper = [experiment.name for experiment in PAPER_EXPERIMENTS]
    wanted = [found for name in names for found in (paper if name == ALL else [name])]
    for name in wanted:
        if name not in EXPERIMENTS:
            known = ", ".join((*EXPERIMENTS, ALL))
            raise ScenarioError(f"there is no experiment {name!r}; choose one or more of: {known}")
        if wanted.count(name) > 1:
            raise ScenarioError(f"the experiment {name!r} is named twice: once is enough")
    return [EXPERIMENTS[name] for name in wanted]


def run(
    experiments: Sequence[Experiment], options: RunOptions, report: Callable[[str], None]
) -> Iterator[ExperimentReport]:
    """Run experiments in order; the results of each are written before it is yielded.

    Raises:
        ScenarioError: An option is invalid, which is found before anything is run, or a file cannot be written.
        SimError, VoxDepthError: A sequence cannot be recorded or corrected.
    """
    contexts = [create_context(experiment, options, report) for experiment in experiments]
    for experiment, context in zip(experiments, contexts, strict=True):
        provenance, findings = Provenance.here(SIMULATION), experiment.answer(context)
        done = ExperimentReport(experiment, context, options.command, provenance, findings)
        done.write()
        yield done


def create_context(experiment: Experiment, options: RunOptions, report: Callable[[str], None]) -> ExperimentContext:
    """The context of an experiment, from its defaults and the options of the user.

    Raises:
        ScenarioError: There are too few frames, or a sequence or the width is invalid.
    """
    context = ExperimentContext(
        out=options.out,
        sequences=experiment.sequences if options.sequences is None else options.sequences,
        frames=experiment.frames if options.frames is None else options.frames,
        width_px=experiment.width_px if options.width_px is None else options.width_px,
        seed=options.seed,
        data=options.data,
        report=lambda what: report(f"{experiment.name}: {what}"),
    )
    if context.frames < experiment.min_frames:
        raise ScenarioError(
            f"{experiment.name} needs at least {experiment.min_frames} frames of each sequence, got --frames "
            f"{context.frames}: ask for more"
        )
    if context.data and not experiment.reads_data:
        raise ScenarioError(f"{experiment.name} reads no recordings: leave out --data")
    for name in context.sequences:
        if context.sequences.count(name) > 1:
            raise ScenarioError(f"--sequences names {name!r} twice: once is enough")
        context.sequence(name)
    return context
