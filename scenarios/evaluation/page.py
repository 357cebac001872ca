"""The report: one HTML file that loads nothing from elsewhere and needs no script."""

from collections.abc import Sequence
from pathlib import Path

from ..benchmark.machine import Machine
from ..files import write
from ..results.page import render_page
from .exhibits import exhibit
from .figures import all_figures
from .quantities import FOR_COMPARISON_ONLY, IN_PAPERS_LAYOUT, QUANTITIES
from .suite import Done
from .tables import by_method, has_figures, in_papers_layout

REPORT = "report.html"
TEMPLATE = "report.html.j2"


def write_report(out: Path, done: Done, machine: Machine) -> None:
    """Write `report.html` in one step.

    Raises:
        ScenarioError: It cannot be written.
    """
    write(out / REPORT, rendered(done, machine).encode())


def rendered(done: Done, machine: Machine) -> str:
    """The text of the report; all that comes from outside is escaped."""
    return render_page(
        TEMPLATE,
        facts=list(done.facts.values()),
        machine=machine,
        papers=[in_papers_layout(done, quantity) for quantity in IN_PAPERS_LAYOUT],
        artefacts=[in_papers_layout(done, quantity) for quantity in FOR_COMPARISON_ONLY],
        tables=[by_method(done, quantity) for quantity in QUANTITIES if has_figures(done, quantity)],
        figures=all_figures(done),
        exhibits=[exhibit(done, facts) for facts in done.facts.values()],
        failures=_failures(done),
        replaced=_replaced(done),
    )


def _failures(done: Done) -> Sequence[tuple[str, str, str]]:
    return [(cell.key.sequence, cell.key.method, cell.error) for cell in done.cells if cell.error is not None]


def _replaced(done: Done) -> Sequence[tuple[str, str, str]]:
    return [(cell.key.sequence, cell.key.method, cell.replaced) for cell in done.cells if cell.replaced is not None]
