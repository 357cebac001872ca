"""The documents say what the published stores say."""

import json
from pathlib import Path

import pytest

from scenarios.study.report import StudyAnalysis
from scenarios.study.store import StudyData, read_study

DOCS = Path(__file__).parents[2] / "docs"
STORES = sorted((DOCS / "study").glob("*.tar.xz"))

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", params=STORES, ids=lambda path: path.name)
def data(request: pytest.FixtureRequest) -> StudyData:
    return read_study(request.param)


def test_every_table_of_a_study_in_the_documents_is_that_of_its_store(data: StudyData) -> None:
    """The documents show those of docs/results, see `tests.results`."""
    result = json.loads((DOCS / "results" / "studies.json").read_text())
    name, found = data.study.name, StudyAnalysis(data).tables
    shown = {key: table for key, table in result["tables"].items() if key.startswith(f"{name}-")}
    shown = {key: table for key, table in shown.items() if key.removeprefix(f"{name}-") in found}
    assert shown, "make results NAME=studies"
    for key, table in shown.items():
        of_store = found[key.removeprefix(f"{name}-")]
        assert table["rows"] == of_store.texts, f"{key}: make results NAME=studies"
        assert table["columns"] == of_store.headings
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
