"""The documents say what the published stores say."""

import lzma
from pathlib import Path

import pytest

from scenarios.study.report import Findings
from scenarios.study.store import FILE, StudyData, read_study

DOCS = Path(__file__).parents[2] / "docs"
ON_COLLISIONS = ("collision_comparisons", "dose_responses", "arms")
"""Tables of the published studies, which were declared on collisions."""
PACKED = sorted((DOCS / "study" / "earlier").glob("*.sqlite.xz"))

pytestmark = pytest.mark.slow


def contents_of(packed: Path, folder: Path) -> StudyData:
    (folder / FILE).write_bytes(lzma.decompress(packed.read_bytes()))
    return read_study(folder)


@pytest.mark.parametrize("packed", PACKED, ids=lambda path: path.name.split(".")[0])
def test_every_row_of_a_published_study_stands_in_the_documents(packed: Path, tmp_path: Path) -> None:
    contents = contents_of(packed, tmp_path)
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
