"""The documents say what the published stores say."""

import lzma
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pytest

from scenarios.study.analysis import TIME_TO_GOAL, ArmSummary, summarise_arms
from scenarios.study.report import Findings
from scenarios.study.store import FILE, StudyData, read_study
from swarm.types import Outcome

DOCS = Path(__file__).parents[2] / "docs"
ON_COLLISIONS = ("collision_comparisons", "dose_responses", "arms")
"""Tables of the earlier studies, which were declared on collisions."""
PACKED = sorted((DOCS / "study" / "earlier").glob("*.sqlite.xz"))

pytestmark = pytest.mark.slow


def contents_of(packed: Iterable[Path], folder: Path) -> StudyData:
    """Return what a store says that is packed in one file or in several parts."""
    (folder / FILE).write_bytes(lzma.decompress(b"".join(part.read_bytes() for part in packed)))
    return read_study(folder)


def arms_of(name: str, folder: Path) -> Mapping[tuple[str, str], ArmSummary]:
    """Return the arms of a present study by scenario and label."""
    data = contents_of(sorted((DOCS / "study").glob(f"{name}.sqlite.xz*")), folder)
    return {(arm.scenario, arm.label): arm for arm in summarise_arms(data)}


def arrivals(arm: ArmSummary) -> int:
    return arm.count(Outcome.SUCCESS)


def mean_time_s(arm: ArmSummary) -> str:
    estimate = arm.estimate(TIME_TO_GOAL)
    assert estimate is not None
    return f"{estimate.value:.1f}"


def missing_rows(rows: Sequence[Sequence[object]]) -> list[str]:
    """Return the rows with which no row of the document of the present studies begins."""
    lines = (DOCS / "study.md").read_text().splitlines()
    written = ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
    return [row for row in written if not any(line.startswith(row) for line in lines)]


@pytest.mark.parametrize("packed", PACKED, ids=lambda path: path.name.split(".")[0])
def test_every_row_of_a_published_study_stands_in_the_documents(packed: Path, tmp_path: Path) -> None:
    contents = contents_of([packed], tmp_path)
    assert not contents.failures
    assert {spec.run.scenario.mission.pilot.holes for spec in contents.specs} == {"fixed_range"}
    documents = "".join((DOCS / name).read_text() for name in ("earlier_studies.md", "scenarios.md"))
    tables = Findings(contents).tables
    lines = "".join(tables[name].markdown() for name in ON_COLLISIONS).splitlines()
    rows = [line for line in lines if line.startswith("| ") and "---" not in line]
    assert len(rows) > len(contents.study.arms)
    assert [row for row in rows if row not in documents] == []


def test_there_are_published_studies() -> None:
    assert "noise.sqlite.xz" in {path.name for path in PACKED}


def test_the_document_tells_how_the_runs_with_noise_ended(tmp_path: Path) -> None:
    arms = arms_of("noise", tmp_path)
    units = ("object", "frame", "pixel")

    def row(theta: str) -> list[object]:
        at_theta = [arms["city", f"one draw per {unit}, theta {theta}"] for unit in units]
        assert {arm.n for arm in at_theta} == {50}
        return [theta, *(fact(arm) for fact in (arrivals, lambda arm: arm.collisions, mean_time_s) for arm in at_theta)]

    assert missing_rows([row(theta) for theta in ("0", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1")]) == []


def test_the_document_tells_how_the_runs_of_each_cell_ended(tmp_path: Path) -> None:
    arms = arms_of("cells", tmp_path)

    def row(cell: str) -> list[object]:
        in_cell = [arms[cell, name] for name in ("raw", "voxdepth", "truth")]
        ends = [f"{arrivals(arm)} of {arm.n}" for arm in in_cell]
        return [cell, *ends, *(arm.collisions for arm in in_cell), *map(mean_time_s, in_cell)]

    assert missing_rows([row(cell) for cell in ("city", "weak", "glass", "exposure", "thin", "moving")]) == []


def test_the_document_tells_how_the_runs_of_each_policy_ended(tmp_path: Path) -> None:
    arms = arms_of("policy", tmp_path)

    def row(label: str, name: str) -> list[object]:
        arm = arms["city", name]
        return [label, f"{arrivals(arm)} of {arm.n}", f"{arm.collisions} of {arm.n}"]

    assert (
        missing_rows(
            [row("raw depth", "free, raw"), row("default", "free, voxdepth"), row("true depth", "free, truth")]
        )
        == []
    )
