"""One table becomes CSV, Markdown, terminal text and HTML cells."""

import io
import math

import pandas as pd
import pytest
from rich.console import Console

from voxdepth.tools.results.table import Column, Table, write_frame


def table() -> Table:
    columns = ("method", Column("MAE", "m", ".3f"), Column("share", "%", lambda x: f"{100 * x:.0f}"), "n")
    rows = [("raw|x", 0.12345, 0.5, 3), ("paper", None, math.nan, 12)]
    return Table.of("errors", columns, rows, note="why")


def test_people_read_rounded_numbers() -> None:
    assert table().texts == [["raw|x", "0.123", "50", "3"], ["paper", "-", "-", "12"]]


def test_markdown_aligns_numbers_to_the_right_and_escapes_bars() -> None:
    assert table().markdown().splitlines() == [
        "| method | MAE [m] | share [%] | n |",
        "| --- | ---: | ---: | ---: |",
        "| raw\\|x | 0.123 | 50 | 3 |",
        "| paper | - | - | 12 |",
    ]


def test_the_parts_of_a_wide_table_begin_with_all_columns_that_tell_its_rows_apart() -> None:
    text = io.StringIO()
    rows = [(sequence, method, *range(100_000, 100_012)) for sequence in ("one", "two") for method in ("raw", "ours")]
    columns = ("sequence", "method", *(f"quantity {k}" for k in range(12)))
    Table.of("", columns, rows).print(Console(file=text, width=60))
    assert text.getvalue().count("sequence") == text.getvalue().count("method") > 1


@pytest.mark.parametrize("width", [32, 80, 150])
def test_a_table_wider_than_the_terminal_is_printed_in_parts_with_the_first_column(width: int) -> None:
    text = io.StringIO()
    numbers = [(name, *(k + 0.25 for k in range(12))) for name in ("raw", "temporal[fill=all]")]
    columns = ("method", *(Column(f"quantity {k}", "mm") for k in range(12)))
    Table.of("errors", columns, numbers).print(Console(file=text, width=width))
    lines = text.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    parts = sum("method" in line for line in lines)
    assert parts == sum("temporal[fill=all]" in line for line in lines)
    assert (parts == 1) == (width == 150)
    assert all(text.getvalue().split().count(f"{k}.25") == 2 for k in range(12))
    assert text.getvalue().count("errors") == 1


def test_a_printed_heading_is_broken_only_where_it_is_wider_than_its_column() -> None:
    text = io.StringIO()
    Table.of("", ("a few words", Column("a few words", "m")), [("as long as that", 0.5)]).print(Console(file=text))
    lines = [line.split() for line in text.getvalue().splitlines()]
    assert [line for line in lines if line][:3] == [["a", "few"], ["words"], ["a", "few", "words", "[m]"]]


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 2"):
        Table.of("t", ("a", "b"), [(1,)])


def test_integers_stay_integers() -> None:
    assert [(n, type(n)) for *_, n in table().rows] == [(3, int), (12, int)]
    assert len(Table.of("empty", ("a",), [])) == 0


def test_a_frame_is_the_same_in_both_files(tmp_path) -> None:
    frame = pd.DataFrame({"name": ["a", "b"], "value": [0.1, math.inf], "n": [1, 2]})
    paths = write_frame(tmp_path / "results", frame)
    assert [path.name for path in paths] == ["results.csv", "results.parquet"]
    pd.testing.assert_frame_equal(pd.read_csv(paths[0]), frame)
    assert pd.read_parquet(paths[1]).equals(frame)


def test_the_headings_of_a_frame_say_how_its_numbers_are_written() -> None:
    frame = pd.DataFrame({"name": ["a", "b"], "error [m]": [0.12345, math.nan], "n": [1, 2], "time [ms]": [1.5, 2.0]})
    table = Table.of_frame("errors", frame)
    assert table.texts == [["a", "0.123", "1", "1.50"], ["b", "-", "2", "2.00"]]
    assert table.rows[1] == ["b", None, 2, 2.0] and type(table.rows[1][2]) is int
    assert table.columns[1] == Column("error", "m", ".3f")


def test_sentences_are_wrapped_and_each_stays_in_its_row() -> None:
    said = "of the methods of the paper, it has the lowest error of all in four of six sequences"
    table = Table.of("claims", ["name", "paper", "here"], [["quality", said, said], ["speed", "fast", "slow"]])
    console = Console(file=io.StringIO(), width=80)
    table.print(console)
    lines = console.file.getvalue().splitlines()
    assert max(map(len, lines)) <= 80
    assert sum("name" in line for line in lines) == 1
    (row,) = (line for line in lines if "quality" in line)
    assert row.count("of the methods") == 2
