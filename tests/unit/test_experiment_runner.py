"""An experiment is checked before anything is run, and written and printed when it ends; claims of the paper."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

from scenarios.errors import ScenarioError
from scenarios.experiments.experiment import Experiment, Findings
from scenarios.experiments.quality import PAPER_M_RMSE, PAPER_PSNR_DB, claim, leads
from scenarios.experiments.runner import find_experiment, run

TABLE = pd.DataFrame({"method": ["one", "two"], "time [ms]": [1.23456, None], "n": [3, 0]})


def answer(asked: Experiment) -> Findings:
    """The same table for every question."""
    return Findings(table=TABLE, notes=("a note",), files={"more.txt": b"more"})


def fail(asked: Experiment) -> Findings:
    raise ScenarioError("it failed")


STUB = Experiment(name="stub", question="What is it?", answer=answer, sequences=("sim-LN",), frames=5, width_px=160)


def report(out: Path, experiment: Experiment = STUB, **given: Any) -> None:
    run(experiment.asked(out=out, **given), "voxdepth experiment stub", Console(width=300))


def test_the_table_is_printed_and_written_with_what_is_needed_to_repeat_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report(tmp_path / "out", frames=4, seed=7)
    printed = capsys.readouterr().out
    for words in ("What is it?", "1.23", "a note", "table.csv, result.json, more.txt are in"):
        assert words in printed
    folder = tmp_path / "out" / "stub"
    with (folder / "table.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["method", "time [ms]", "n"], ["one", "1.23456", "3"], ["two", "", "0"]]
    assert (folder / "more.txt").read_text() == "more"
    stored = json.loads((folder / "result.json").read_text())
    assert (stored["seed"], stored["frames"], stored["width_px"]) == (7, 4, 160)
    assert stored["command"] == "voxdepth experiment stub"
    assert stored["provenance"]["machine"] and "numpy" in stored["provenance"]["versions"]
    assert stored["notes"] == ["a note"]


def test_what_the_user_does_not_say_the_experiment_does() -> None:
    assert replace(STUB, seed=7).asked(seed=0).seed == 0
    asked = STUB.asked(frames=None)
    assert (asked.sequences, asked.frames, asked.width_px) == (("sim-LN",), 5, 160)
    rig = asked.sequence("sim-LN").sequence.rig
    assert (rig.width_px, rig.height_px) == (160, 90), "the shape of the sequence stays"
    assert asked.sequence("sim-KTC").sequence.rig.height_px == 160


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sequences": ("sim-XX",)}, "there is no sequence 'sim-XX'"),
        ({"width_px": 20}, "rig.width_px: expected at least 32, got 20"),
    ],
)
def test_what_cannot_be_is_said(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        STUB.asked(**given)


def test_a_failure_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="it failed"):
        report(tmp_path, replace(STUB, answer=fail))
    assert not (tmp_path / "stub").exists()


def test_quality_needs_frames_after_the_warm_up() -> None:
    quality = find_experiment("quality")
    with pytest.raises(ScenarioError, match="quality needs more than 16 frames of each sequence, got 16"):
        quality.answer(quality.asked(frames=16))


def masked(**vd_m: float) -> str:
    """The claim about the masked error, where RS and GS have errors of 2 and 3 m."""
    errors_m = pd.DataFrame({"VD": vd_m, "RS": 2.0, "GS": 3.0})
    errors_m.index = [f"sim-{name}" for name in errors_m.index]
    return claim("the lowest masked error", leads(-errors_m), leads(-PAPER_M_RMSE))


def test_the_order_is_compared_with_the_paper_in_the_sequences_that_were_asked_for() -> None:
    paper = "paper: of VD, RS and GS, VD has the lowest masked error in 1 of 2 (sim-LN); here in "
    assert masked(LN=1.0, MB=2.5) == f"{paper}1 of 2 (sim-LN): agrees"
    assert masked(LN=2.5, MB=1.0) == f"{paper}1 of 2 (sim-MB): differs"
    assert masked(LN=2.5, MB=2.5) == f"{paper}0 of 2 (none): differs", "one of two is not more than half"


def test_the_paper_s_own_tables_say_where_its_method_leads() -> None:
    assert list(leads(PAPER_PSNR_DB)) == [True, True, False, True, True, True]
    assert list(leads(-PAPER_M_RMSE)) == [True, False, True, True, True, False]
    assert (PAPER_M_RMSE > 175).sum(axis=None) == 13, "nearly those of unrelated images"


def test_nothing_is_claimed_without_the_datasets_that_it_is_about() -> None:
    assert masked(drive=1.0) == masked(LN=float("nan"))
    assert "no dataset for these sequences" in masked(drive=1.0)
