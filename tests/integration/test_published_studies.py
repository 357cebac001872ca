"""The documents say what the published stores say."""

from pathlib import Path

import pytest

from scenarios.study.report import Findings
from scenarios.study.store import StudyData, read_study

DOCS = Path(__file__).parents[2] / "docs"
STORES = sorted((DOCS / "study").glob("*.tar.xz"))

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=STORES, ids=lambda path: path.name)
def data(request: pytest.FixtureRequest) -> StudyData:
    return read_study(request.param)


def test_every_table_of_a_study_in_the_documents_is_that_of_its_store(data: StudyData) -> None:
    """A section of the document has the name of the study, and its tables are those of the report, line by line."""
    text = (DOCS / "study.md").read_text()
    section = text[text.index(f"\n## `{data.study.name}`") :].split("\n## ")[1]
    lines = [line for line in section.splitlines() if line.startswith("|")]
    report = {line for table in Findings(data).tables.values() for line in table.markdown().splitlines()}
    assert len(lines) > 4
    assert [line for line in lines if line not in report] == []
    assert f"{len(data.records)} of {len(data.runs)} runs" in section
    assert not data.failures


def test_every_collision_with_a_fixed_body_follows_an_unsafe_commitment() -> None:
    hits = 0
    for record in (record for path in STORES for record in read_study(path).records.values()):
        struck = {contact.drone for contact in record.contacts if contact.kind in ("building", "ground")}
        for row in record.drones:
            if row["drone"] in struck:
                hits += 1
                assert row["unsafe_commitments"], record.contacts
    assert hits
