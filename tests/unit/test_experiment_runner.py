"""Experiments run one after the other: checked before anything is run, and each written as it ends."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from scenarios.errors import ScenarioError
from scenarios.experiments.collisions import small_study
from scenarios.experiments.experiment import Claim, Experiment, ExperimentContext, Findings, verdict
from scenarios.experiments.runner import (
    EXPERIMENTS,
    PAPER_EXPERIMENTS,
    ExperimentReport,
    find_experiments,
    run,
    write_index,
)
from scenarios.study.design import expand, load_study
from voxdepth.tools.errors import ToolError
from voxdepth.tools.figure import label_axes, panels

TABLE = pd.DataFrame({"method": ["one", "two"], "time [ms]": [1.23456, None], "n": [3, 0]})
PNG = b"\x89PNG"


def answer(context: ExperimentContext) -> Findings:
    """The same table for every question."""
    return Findings(
        tables={"table": TABLE},
        claims=(Claim("fast", "slow", False, "it is fast"),),
        notes=(f"{context.frames} frames",),
        figure=panels("title", [lambda axes: label_axes(axes, "panel", "x [m]", "y [s]")]),
        files={"more.txt": b"more"},
    )


def fail(context: ExperimentContext) -> Findings:
    raise ScenarioError("it failed")


STUB = Experiment(
    name="stub", question="What is it?", answer=answer, sequences=("sim-LN",), frames=5, width_px=160, min_frames=3
)


def report(out: Path, experiment: Experiment = STUB, **given: Any) -> ExperimentReport:
    return run(experiment, experiment.context(out, lambda what: None, **given), "voxdepth experiment stub")


def test_table_figure_and_report_are_written(tmp_path: Path) -> None:
    report(tmp_path / "out", frames=4, seed=7)
    folder = tmp_path / "out" / "stub"
    with (folder / "table.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["method", "time [ms]", "n"], ["one", "1.23456", "3"], ["two", "", "0"]]
    assert (folder / "figure.png").read_bytes().startswith(PNG)
    assert (folder / "more.txt").read_text() == "more"
    assert (folder / "table.md").read_text() == (
        "Of 1 claim of the paper, 1 differs.\n\n`voxdepth experiment stub`\n\n**stub: table**\n\n"
        "| method | time [ms] | n |\n| --- | ---: | ---: |\n| one | 1.23 | 3 |\n| two | - | 0 |\n"
        "\n4 frames\n"
    )
    stored = json.loads((folder / "result.json").read_text())
    assert stored["tables"][0]["rows"] == [["one", 1.23456, 3], ["two", None, 0]]
    assert (stored["seed"], stored["frames"], stored["width_px"]) == (7, 4, 160)
    assert stored["command"] == "voxdepth experiment stub"
    assert stored["provenance"]["processor"] and "numpy" in stored["provenance"]["versions"]
    assert stored["claims"] == [{"paper": "fast", "found": "slow", "holds": False, "agrees_if": "it is fast"}]


def test_what_the_user_does_not_say_the_experiment_does(tmp_path: Path) -> None:
    context = STUB.context(tmp_path, print, frames=None)
    assert (context.sequences, context.frames, context.width_px) == (("sim-LN",), 5, 160)
    rig = context.sequence("sim-LN").sequence.rig
    assert (rig.width_px, rig.height_px) == (160, 90), "the shape of the sequence stays"
    assert context.sequence("sim-KTC").sequence.rig.height_px == 160


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frames": 2}, "stub needs at least 3 frames of each sequence, got --frames 2"),
        ({"sequences": ("sim-XX",)}, "there is no sequence 'sim-XX'"),
        ({"sequences": ("sim-LN", "sim-LN")}, "--sequences names 'sim-LN' twice"),
        ({"width_px": 20}, "--width must be 64 to 2048 pixels, got 20"),
    ],
)
def test_what_cannot_be_is_said(given: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=message):
        STUB.context(tmp_path / "out", print, **given)


def test_a_failure_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="it failed"):
        report(tmp_path, replace(STUB, answer=fail))
    assert not (tmp_path / "stub").exists()


def test_a_file_in_the_way_is_told(tmp_path: Path) -> None:
    (tmp_path / "stub").write_text("not a folder")
    with pytest.raises(ToolError, match="cannot write"):
        report(tmp_path)


def test_the_index_has_every_claim_of_the_experiments_that_have_results(tmp_path: Path) -> None:
    for name in ("fps", "quality"):
        report(tmp_path, replace(STUB, name=name))
    table = write_index(tmp_path)
    assert [tuple(row) for row in table.rows] == [
        (name, "fast", "slow", "differs", "it is fast") for name in ("quality", "fps")
    ]
    page = (tmp_path / "index.md").read_text()
    assert "| quality | fast | slow | differs |" in page
    assert "- [fps](fps/table.md), [figure](fps/figure.png): What is it?" in page


def test_the_small_study_of_collisions_flies_few_runs_of_the_whole_one() -> None:
    study, whole = small_study(5), load_study("noise")
    assert (len(study.arms), len(study.arms[0].theta), study.seeds.count) == (1, 5, 5)
    keys = {spec.key for spec in expand(study)}
    assert len(keys) == 25
    assert keys < {spec.key for spec in expand(whole)}, "equal runs"


def test_names() -> None:
    paper = [experiment.name for experiment in PAPER_EXPERIMENTS]
    assert set(paper) < set(EXPERIMENTS)
    assert [experiment.name for experiment in find_experiments(["fps", "quality"])] == ["fps", "quality"]
    assert [experiment.name for experiment in find_experiments(["all"])] == paper
    with pytest.raises(ScenarioError, match=r"no experiment 'qualty' \(did you mean quality"):
        find_experiments(["qualty"])
    with pytest.raises(ScenarioError, match="'quality' is named twice"):
        find_experiments(["all", "quality"])


def test_the_verdict_counts_the_claims_that_agree() -> None:
    claims = [Claim("", "", holds) for holds in (True, True, False, None)]
    assert verdict(claims) == "Of 4 claims of the paper, 2 agree, 1 differs, 1 is open."
    assert verdict(claims[2:3]) == "Of 1 claim of the paper, 1 differs."
    assert "no claim" in verdict([])
