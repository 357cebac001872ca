"""The tables in documents are those of their files, which say by which command and commit they were made."""

import re
import tomllib
from pathlib import Path

import pytest

from scenarios.experiments.catalogue import CATALOGUE
from tests.results import documents
from tests.results.data import Data
from tests.results.documents import (
    DOCUMENTS,
    RESULTS,
    SHOWN,
    pictures_shown,
    read,
    result_of,
    tables_shown,
    with_tables,
)
from tests.results.makers import MAKERS
from voxdepth.tools.errors import ToolError
from voxdepth.tools.results.table import Column, Table

NUMBER = re.compile(
    r"(?<![\w.])(\d+(?:\.\d+)?)\s(%|ms|s|min|minutes|hours|points|times|MB|GB|dB|frames/s|steps/s)(?![\w%])"
)
"""A number with a unit in which something can be measured."""
NOT_MEASURED = Path(__file__).with_name("numbers.toml")
HASH = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,12}\b")
TABLE = Table.of("Errors", ["name", Column("error", "m"), "kind"], [["a|b", 0.5, "x"], ["c", None, "y"]])


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_a_table_in_a_document_is_that_of_its_file(document: Path) -> None:
    text = document.read_text()
    made = {found[1]: read(found[1]) for found in SHOWN.finditer(text)}
    assert with_tables(text, made) == text, "make results remakes them"
    assert len(re.findall(r"^<!-- (?:result|end)", text, re.MULTILINE)) == 2 * len(SHOWN.findall(text))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_only_tables_name_a_commit(document: Path) -> None:
    assert HASH.findall(SHOWN.sub("", document.read_text())) == []


def numbers_of(document: Path) -> list[str]:
    """The numbers of a document outside of results, and of what a reader types."""
    prose = re.sub(r"```.*?```|`[^`]*`", "", SHOWN.sub("", document.read_text()), flags=re.DOTALL)
    return sorted({f"{found[1]} {found[2]}" for found in NUMBER.finditer(prose)})


def test_what_is_measured_stands_in_a_result_and_not_in_prose() -> None:
    found = {path.name: numbers for path in DOCUMENTS if (numbers := numbers_of(path))}
    listed = tomllib.loads(NOT_MEASURED.read_text())
    assert found == {name: sorted(of) for name, of in listed.items()}, (
        f"a number that was measured belongs to a result, which remakes it; one that was not, to {NOT_MEASURED.name}"
    )


def test_each_figure_of_a_result_is_shown_and_can_be_made() -> None:
    shown = {f"{name}-{key}.png" for name in MAKERS for key in pictures_shown(name)}
    assert shown == {path.name for path in RESULTS.glob("*.png")}
    assert pictures_shown("experiments") <= CATALOGUE.keys()
    made = MAKERS["studies"].make(Data(None))
    assert pictures_shown("studies") <= made.pictures.keys()
    assert tables_shown("studies") <= made.tables.keys()


def test_each_result_is_shown_and_can_be_made() -> None:
    shown = {found[1] for path in DOCUMENTS for found in SHOWN.finditer(path.read_text())}
    assert {path.stem for path in RESULTS.glob("*.json")} == shown <= set(MAKERS)


def test_a_document_shows_the_tables_that_it_names_and_a_result_holds_no_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    document = tmp_path / "page.md"
    document.write_text(
        "Before\n\n<!-- result errors all -->\n<!-- end -->\n\nafter\n<!-- result other x -->\n<!-- end -->\n"
    )
    monkeypatch.setattr(documents, "DOCUMENTS", (document,))
    made = result_of("errors", {"all": TABLE, "unseen": TABLE})
    assert list(made.tables) == ["all"]
    text = with_tables(document.read_text(), {"errors": made})
    assert text.startswith(
        "Before\n\n<!-- result errors all -->\n\n| name | error [m] | kind |\n| --- | ---: | --- |\n"
    )
    assert "| a\\|b | 0.50 | x |\n| c | - | y |\n" in text
    assert f"*Errors (`make results NAME=errors`, commit {made.commit}, {made.date}" in text
    assert text.endswith("<!-- result other x -->\n<!-- end -->\n")
    assert with_tables(text, {"errors": made}) == text
    with pytest.raises(ToolError, match="shows errors all, which is none of its tables: unseen"):
        result_of("errors", {"unseen": TABLE})
    assert made.markdown("all") in text
