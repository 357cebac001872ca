"""Experiments run one after the other: checked before anything is run, and each written as it ends."""

import csv
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from scenarios.errors import ScenarioError
from scenarios.experiments.catalogue import EXPERIMENT_NAMES, PAPER_NAMES, find_experiments
from scenarios.experiments.drawing import labelled, panels
from scenarios.experiments.result import Claim, Column, Result, Table, text_of
from scenarios.experiments.runner import Report, Wishes, run, staged, verdict
from scenarios.experiments.stage import Scope, Stage

COLUMNS = (Column(name="method"), Column(name="time", unit="ms"), Column(name="n", places=0))
ROWS = [("one", 1.23456, 3), ("two", None, 0)]
PNG = b"\x89PNG"
SCOPE = Scope(sequences=("sim-LN",), frames=5, width_px=160, least_frames=3)


def drawn() -> bytes:
    return panels("title", lambda axes: labelled(axes, "panel", "x [m]", "y [s]"))


@dataclass(frozen=True)
class Stub:
    """Gives the same table whatever it is asked."""

    name: str = "stub"
    question: str = "What is it?"
    scope: Scope = SCOPE
    fails: bool = False

    def run(self, stage: Stage) -> Result:
        if self.fails:
            raise ScenarioError("it failed")
        table = Table.of("Times", COLUMNS, ROWS)
        claim = Claim(paper="fast", found="slow", holds=False)
        notes = (f"{stage.frames} frames",)
        return Result(tables=(table,), claims=(claim,), notes=notes, figure=drawn(), pictures={"last": PNG})


def reports(wishes: Wishes, *experiments: Any) -> list[Report]:
    return list(run(experiments, wishes, lambda what: None))


def test_table_figure_and_report_are_written(tmp_path: Path) -> None:
    wishes = Wishes(out=tmp_path / "out", frames=4, seed=7, command="voxdepth experiment stub")
    (report,) = reports(wishes, Stub())
    folder = tmp_path / "out" / "stub"
    with (folder / "table.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["method", "time [ms]", "n"], ["one", "1.23456", "3"], ["two", "", "0"]]
    assert (folder / "figure.png").read_bytes().startswith(PNG)
    assert (folder / "last.png").read_bytes() == PNG
    assert (folder / "table.md").read_text() == (
        "`voxdepth experiment stub`\n\n**Times**\n\n"
        "| method | time [ms] | n |\n| --- | ---: | ---: |\n| one | 1.23 | 3 |\n| two | - | 0 |\n"
    )
    stored = json.loads((folder / "result.json").read_text())
    assert stored["result"]["tables"][0]["rows"] == [list(row) for row in ROWS]
    assert (stored["seed"], stored["frames"], stored["width_px"]) == (7, 4, 160)
    assert stored["command"] == "voxdepth experiment stub"
    assert stored["machine"]["processor"] and "numpy" in stored["machine"]["versions"]
    assert (
        Report.model_validate_json(json.dumps(stored | {"result": stored["result"] | {"figure": ""}})).result.table
        == report.result.table
    )


def test_what_the_user_does_not_say_the_experiment_does(tmp_path: Path) -> None:
    stage = staged(Stub(), Wishes(out=tmp_path), lambda what: None)
    assert (stage.sequences, stage.frames, stage.width_px) == (("sim-LN",), 5, 160)
    rig = stage.planned("sim-LN").sequence.rig
    assert (rig.width_px, rig.height_px) == (160, 90), "the shape of the sequence stays"
    assert stage.planned("sim-KTC").sequence.rig.height_px == 160


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ({"frames": 2}, "stub needs at least 3 frames of each sequence, got --frames 2"),
        ({"sequences": ("sim-XX",)}, "there is no sequence 'sim-XX'"),
        ({"sequences": ("sim-LN", "sim-LN")}, "--sequences names 'sim-LN' twice"),
        ({"width_px": 20}, "--width must be 64 to 2048 pixels, got 20"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_run(wishes: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message):
        reports(Wishes(out=tmp_path / "out", **wishes), Stub(name="first", scope=Scope(sequences=(), frames=9)), Stub())
    assert not (tmp_path / "out").exists()


def test_a_failure_leaves_what_was_done_before(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="it failed"):
        reports(Wishes(out=tmp_path), Stub(name="first"), Stub(name="second", fails=True))
    assert (tmp_path / "first" / "result.json").is_file()
    assert not (tmp_path / "second").exists()


def test_a_file_in_the_way_is_told(tmp_path: Path) -> None:
    (tmp_path / "stub").write_text("not a folder")
    with pytest.raises(ScenarioError, match="cannot write"):
        reports(Wishes(out=tmp_path), Stub())


def test_names() -> None:
    assert PAPER_NAMES == (
        "rq1", "rq2", "rq3", "rq4", "quality", "fps", "components", "power", "window", "switches"
    )  # fmt: skip
    assert list(EXPERIMENT_NAMES) == [*PAPER_NAMES, "default", "ablation"]
    assert [experiment.name for experiment in find_experiments(["fps", "rq1"])] == ["fps", "rq1"]
    assert [experiment.name for experiment in find_experiments(["all"])] == list(PAPER_NAMES)
    with pytest.raises(ScenarioError, match="no experiment 'rq5'; choose one or more of: rq1, rq2"):
        find_experiments(["rq5"])
    with pytest.raises(ScenarioError, match="'rq1' is named twice"):
        find_experiments(["all", "rq1"])


def test_a_row_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 3 values"):
        Table.of("Times", COLUMNS, [("one", 1.0)])


def test_text_of_values() -> None:
    assert text_of(None, COLUMNS[1]) == "-"
    assert text_of(1.23456, COLUMNS[1]) == "1.23"
    assert text_of(3, COLUMNS[2]) == "3"
    assert [verdict(Claim(paper="", found="", holds=holds)) for holds in (True, False, None)] == [
        "agrees", "differs", "open"
    ]  # fmt: skip
