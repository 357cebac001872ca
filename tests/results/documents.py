"""Results in documents: a table between two comments, `<!-- result NAME TABLE -->` and `<!-- end -->`, and figures."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime

from voxdepth.tools.errors import ToolError
from voxdepth.tools.files import write
from voxdepth.tools.results.provenance import Provenance
from voxdepth.tools.results.store import Records
from voxdepth.tools.results.table import Table
from voxdepth.tools.results.table import markdown as table_markdown

from .data import ROOT, Made

RESULTS = ROOT / "docs/results"
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
SHOWN = re.compile(r"<!-- result (\S+) (\S+) -->\n(.*?)<!-- end -->", re.DOTALL)
"""A table in a document."""


@dataclass(frozen=True, kw_only=True)
class DocumentTable:
    """A table as documents show it."""

    title: str
    columns: list[str]
    right: list[bool]
    """Which columns are aligned to the right."""
    rows: list[list[str]]

    @classmethod
    def of(cls, table: Table) -> "DocumentTable":
        """Return a table with its values as people read them."""
        right = [table.is_numeric(index) for index in range(len(table.columns))]
        return cls(title=table.title, columns=table.headings, right=right, rows=table.texts)


@dataclass(frozen=True, kw_only=True)
class Result:
    """The content of `docs/results/NAME.json`: the tables that documents show, and what they were made with."""

    command: str
    commit: str | None
    date: str
    machine: str
    versions: dict[str, str]
    tables: dict[str, DocumentTable]

    def markdown(self, key: str) -> str:
        """Return a table as documents show it."""
        table = self.tables[key]
        made = f"`{self.command}`, commit {self.commit}, {self.date}, {self.machine}"
        return f"{table_markdown(table.columns, table.rows, table.right)}\n*{table.title} ({made}).*\n"


RECORDS = Records(Result)


def result_of(name: str, tables: Mapping[str, Table]) -> Result:
    """Return the tables of a result that documents show; one that is shown and was not made is a `ToolError`."""
    here, shown = Provenance.here(), tables_shown(name)
    if missing := shown - set(tables):
        raise ToolError(f"a document shows {name} {missing.pop()}, which is none of its tables: {', '.join(tables)}")
    return Result(
        command=f"make results NAME={name}",
        commit=here.commit,
        date=datetime.now(UTC).date().isoformat(),
        machine=here.machine,
        versions=here.versions,
        tables={key: DocumentTable.of(table) for key, table in tables.items() if key in shown},
    )


def read(name: str) -> Result:
    """Read a result."""
    return RECORDS.decode((RESULTS / f"{name}.json").read_bytes())


def publish(name: str, made: Made) -> None:
    """Write a result and its figures, and show its tables in the documents."""
    result = result_of(name, made.tables)
    RECORDS.write(RESULTS / f"{name}.json", result)
    for key in pictures_shown(name):
        write(RESULTS / f"{name}-{key}.png", made.pictures[key])
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        if (now := with_tables(text, {name: result})) != text:
            write(path, now.encode())
            print(f"{path.relative_to(ROOT)} shows {name}")


def tables_shown(name: str) -> set[str]:
    """Return which tables of a result documents show."""
    texts = (path.read_text(encoding="utf-8") for path in DOCUMENTS)
    return {found[2] for text in texts for found in SHOWN.finditer(text) if found[1] == name}


def pictures_shown(name: str) -> set[str]:
    """Return which figures of a result documents show."""
    shown = re.compile(rf"\]\((?:docs/)?results/{name}-(\S+)\.png\)")
    return {found[1] for path in DOCUMENTS for found in shown.finditer(path.read_text(encoding="utf-8"))}


def with_tables(document: str, results: Mapping[str, Result]) -> str:
    """Return a document with the present tables of results; those of others stay."""

    def shown(found: re.Match[str]) -> str:
        name, key = found[1], found[2]
        if name not in results:
            return found[0]
        return f"<!-- result {name} {key} -->\n\n{results[name].markdown(key)}\n<!-- end -->"

    return SHOWN.sub(shown, document)
