"""An experiment is checked before anything is run, and written and printed when it ends."""

import csv
import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from rich.console import Console

from scenarios.errors import ScenarioError
from scenarios.evaluation import with_truth
from scenarios.experiments import runner
from scenarios.experiments.catalogue import CATALOGUE, Entry, duration_text
from scenarios.experiments.experiment import Claim, Experiment, ExperimentResult, all_hold, counted, most_hold, summary
from scenarios.experiments.runner import find_experiment, kept, show
from tests.commands import invoke

TABLE = pd.DataFrame({"method": ["one", "two"], "time [ms]": [1.23456, None], "n": [3, 0]})
CLAIM = Claim("one is faster", "it takes 1.2 ms", None, "both are known")


def answer(experiment: Experiment) -> ExperimentResult:
    """The same table for every question."""
    return ExperimentResult(table=TABLE, figure=b"drawn")


def fail(experiment: Experiment) -> ExperimentResult:
    raise ScenarioError("it failed")


STUB = Experiment(
    question="What is it?",
    answer=answer,
    claims=lambda table: (CLAIM,),
    notes=("a note",),
    sequences=("sim-LN",),
    frames=5,
    width_px=160,
)


@pytest.fixture
def stub(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOGUE, "stub", Entry("tab:stub", "it is something", 0.1))


def report(out: Path, experiment: Experiment = STUB, **given: Any) -> None:
    asked = experiment.with_options(out=out, **given)
    show(runner.answer("stub", asked, "voxdepth experiment stub"), out / "stub", Console(width=300))


@pytest.mark.usefixtures("stub")
def test_the_table_is_printed_and_written_with_what_is_needed_to_repeat_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report(tmp_path / "out", frames=4, seed=7)
    printed = capsys.readouterr().out
    told_of_claim = "paper: one is faster\nhere:  it takes 1.2 ms\n       (open; it agrees if both are known)\n"
    for words in (
        "tab:stub: What is it?",
        "1.23",
        told_of_claim,
        "note:  a note",
        "table.csv, figure.png, result.json are",
    ):
        assert words in printed
    folder = tmp_path / "out" / "stub"
    with (folder / "table.csv").open(newline="") as file:
        assert list(csv.reader(file)) == [["method", "time [ms]", "n"], ["one", "1.23456", "3"], ["two", "", "0"]]
    assert (folder / "figure.png").read_bytes() == b"drawn"
    stored = json.loads((folder / "result.json").read_text())
    assert stored["label"] == "tab:stub"
    assert {"seed": 7, "frames": 4, "width_px": 160}.items() <= stored["options"].items()
    assert stored["command"] == "voxdepth experiment stub"
    assert stored["provenance"]["machine"] and "numpy" in stored["provenance"]["versions"]
    assert stored["notes"] == ["a note"]
    assert [claim["holds"] for claim in stored["claims"]] == [None]


@pytest.mark.usefixtures("stub")
def test_an_answer_is_kept_for_the_same_question_and_no_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = STUB.with_options(out=tmp_path, frames=4)
    assert kept("stub", asked) is None
    record = runner.answer("stub", asked, "voxdepth experiment stub")
    assert kept("stub", asked) == record
    assert kept("stub", asked.with_options(frames=3)) is None
    assert kept("stub", replace(asked, sequences=(), data=(tmp_path,))) is None
    with monkeypatch.context() as patch:
        patch.setattr(runner, "code_digest", lambda sources: "other")
        assert kept("stub", asked) is None
    path = tmp_path / "stub" / "result.json"
    path.write_bytes(path.read_bytes().replace(b"it takes 1.2 ms", b"it takes 1.3 ms"))
    assert kept("stub", asked) is None


def test_what_the_user_does_not_say_the_experiment_does() -> None:
    assert replace(STUB, seed=7).with_options(seed=0).seed == 0
    experiment = STUB.with_options(frames=None)
    assert (experiment.sequences, experiment.frames, experiment.width_px) == (("sim-LN",), 5, 160)
    rig = experiment.sequence("sim-LN").sequence.rig
    assert (rig.width_px, rig.height_px) == (160, 90), "the shape of the sequence stays"
    assert experiment.sequence("sim-KTC").sequence.rig.height_px == 160


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"sequences": ("sim-XX",)}, "there is no sequence 'sim-XX'"),
        ({"width_px": 20}, "rig.width_px: expected at least 32, got 20"),
        ({"frames": 2}, "expected at least 3 frames of each sequence, got 2"),
        ({"sequences": ("sim-LN",), "data": (Path("walk"),)}, "--data takes the place of the sequences: leave out"),
    ],
)
def test_what_cannot_be_is_said(given: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        replace(STUB, least_frames=3).with_options(**given)


@pytest.mark.parametrize(("given", "option"), [({"frames": 3}, "--frames"), ({"width_px": 160}, "--width")])
def test_an_experiment_that_needs_no_frames_refuses_some(given: dict[str, int], option: str) -> None:
    with pytest.raises(ScenarioError, match=f"'What is it[?]' is not asked of images: leave out {option}"):
        replace(STUB, sequences=(), frames=0, width_px=None).with_options(**given)


@pytest.mark.usefixtures("stub")
def test_a_failure_writes_nothing(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match="it failed"):
        report(tmp_path, replace(STUB, answer=fail))
    assert not (tmp_path / "stub").exists()


def test_each_experiment_is_a_module_of_its_name_and_is_listed_with_label_claim_and_time() -> None:
    listing = " ".join(invoke("experiment", "--help").output.replace("│", " ").split())
    for name, entry in CATALOGUE.items():
        assert isinstance(find_experiment(name), Experiment)
        assert f"{name} {entry.label}: {entry.claim}; {duration_text(entry.minutes)}." in listing
    minutes = sum(entry.minutes for entry in CATALOGUE.values())
    assert minutes <= 45 and f"{duration_text(minutes)}." in listing


def test_all_run_in_the_order_of_the_paper_and_their_claims_are_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in CATALOGUE:
        monkeypatch.setattr(import_module(f"scenarios.experiments.{name}"), "EXPERIMENT", STUB)
    printed = invoke("experiment", "all", "--out", tmp_path).output
    assert {path.name for path in tmp_path.iterdir()} == CATALOGUE.keys()
    assert f"claims of the paper: {len(CATALOGUE)} open" in printed
    _, _, listing = printed.partition("claims of the paper")
    positions = [listing.index(f" {name} ") for name in CATALOGUE]
    assert positions == sorted(positions)


def test_an_experiment_without_data_refuses_some(tmp_path: Path) -> None:
    done = invoke("experiment", "rq1", "--data", tmp_path)
    assert str(done.exception) == "rq1 reads no recordings: leave out --data"


def test_a_recording_without_the_truth_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"has no true depth: expected a recording of the simulator, a trajectory"):
        with_truth(tmp_path)


def test_a_damaged_recording_of_the_simulator_is_named(tmp_path: Path) -> None:
    (tmp_path / "frames.csv").write_text("timestamp_s,r11\n")
    with pytest.raises(ScenarioError, match=r"^(?!.*has no true depth).*"):
        with_truth(tmp_path)


def test_verdicts() -> None:
    claims = [replace(CLAIM, holds=holds) for holds in (True, False, False, None)]
    assert summary(claims) == "claims of the paper: 1 agrees, 2 differs, 1 open"
    assert (all_hold([]), all_hold([True, False]), all_hold([True])) == (None, False, True)
    assert (most_hold([]), most_hold([True, False]), most_hold([True, True, False])) == (None, False, True)
    assert counted(pd.Series({"a": True, "b": False})) == "1 of 2 (a)"
    assert counted(pd.Series({"a": False})) == "0 of 1 (none)"
