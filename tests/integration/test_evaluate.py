"""`voxdepth evaluate` as a user meets it."""

import csv
import json
import shutil
import sys
from pathlib import Path

import pytest

from scenarios.files import shipped_names
from scenarios.sequences import GROUPS
from tests.commands import invoke
from tests.evaluation_clips import write_recording
from voxdepth.datasets import open_dataset
from voxdepth.tools.evaluate import _planned
from voxdepth.tools.evaluation import suite
from voxdepth.tools.evaluation.recordings import HELD_OUT


def values(out: Path) -> dict[tuple[str, ...], str]:
    with (out / "results.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("sequence", "method", "metric", "mask", "range", "on")
    return {tuple(row[name] for name in names): row["value"] for row in rows if row["on"] != "frames"}


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording with the truth, and one without."""
    base = tmp_path_factory.mktemp("data")
    plain = write_recording(base / "plain")
    shutil.rmtree(plain / "depth_true")
    return write_recording(base / "post"), plain


@pytest.mark.slow
def test_everything_is_written_and_a_repetition_takes_it(folders: tuple[Path, Path], tmp_path: Path) -> None:
    post, plain = folders
    command = ("--data", post, "--data", plain, "--methods", "raw,ip-basic", "--frames", "5")
    done = invoke("evaluate", *command, "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    for words in ("plain: ", "wide", "patches", "own", "0 of them finished before"):
        assert words in done.output, words
    page = (tmp_path / "out" / "report.html").read_text()
    for words in ("the truth", "plain-shadows", "held-out patches", "later frames"):
        assert words in page, words
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "results", "results.csv", "results.parquet", "report.html", "write.lock"
    }  # fmt: skip
    result = json.loads((tmp_path / "out" / "results" / "post" / "raw.json").read_text())
    assert result["key"]["frames"] == 5
    assert set(result["key"]["versions"]) >= {"voxdepth", "numpy"}
    before = values(tmp_path / "out")
    again = invoke("evaluate", *command, "--out", tmp_path / "out")
    assert "10 results, 10 of them finished before" in again.output, again.output
    assert values(tmp_path / "out") == before


def test_a_baseline_that_is_assumed_is_reported_once_although_every_kind_opens_the_recording(
    folders: tuple[Path, Path], tmp_path: Path
) -> None:
    shutil.copytree(folders[1], tmp_path / "walk")
    calibration = tmp_path / "walk" / "calibration.toml"
    kept = [line for line in calibration.read_text().splitlines(keepends=True) if "baseline_m" not in line]
    calibration.write_text("".join(kept))
    done = invoke(
        "evaluate", "--data", tmp_path / "walk", "--methods", "raw", "--frames", "3", "--out", tmp_path / "out"
    )
    assert done.exit_code == 0, done.output
    assert "walk-patches" in done.stdout
    assert done.stderr.count("states no baseline of its camera, 0.05 m is assumed: state it in metres by ") == 1
    assert f"as baseline_m in {calibration}\n" in done.stderr


def test_an_interrupted_evaluation_goes_on(
    folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ("--data", folders[0], "--methods", "raw,median", "--frames", "3", "--out", tmp_path)
    really = suite.run

    def interrupted(method: suite.Method, *rest: object) -> object:
        if method.name == "median":
            raise KeyboardInterrupt
        return really(method, *rest)

    monkeypatch.setattr(suite, "run", interrupted)
    stopped = invoke("evaluate", *command)
    assert stopped.exit_code != 0
    assert "the same command goes on" in stopped.output
    assert {path.name for path in tmp_path.iterdir()} == {"results", "write.lock"}
    monkeypatch.setattr(suite, "run", really)
    assert "2 results, 1 of them finished before" in invoke("evaluate", *command).output


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ([], GROUPS["reference"]),
        (["hard"], GROUPS["hard"]),
        (["sim-ghost", "reference"], ("sim-ghost", *GROUPS["reference"])),
    ],
)
def test_a_group_stands_for_its_sequences(given: list[str], names: tuple[str, ...], tmp_path: Path) -> None:
    plan = _planned(given, [], open_dataset, "raw", 1, None, tmp_path)
    assert tuple(requested.name for requested in plan.sequences) == names
    assert set(names) <= set(shipped_names("sequences"))
    requested = _planned([], [tmp_path], open_dataset, "raw", 1, None, tmp_path).sequences
    assert [one.name for one in requested] == [f"{tmp_path.name}-{mask}" for mask in HELD_OUT]


def test_a_package_that_writes_the_results_is_requested_before_the_work(
    folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)  # Python's mark of a missing package.
    done = invoke("evaluate", "--data", folders[0], "--methods", "raw", "--frames", "2", "--out", tmp_path / "out")
    assert isinstance(done.exception, ModuleNotFoundError)
    assert not (tmp_path / "out").exists()


def test_commas_in_a_setting_do_not_part_methods(tmp_path: Path) -> None:
    names = ["temporal[fill=all]", "voxdepth[voxels.cell_m=[0.2,0.2,0.1]]", "raw"]
    plan = _planned(["sim-LN"], [], open_dataset, ", ".join(names), 1, None, tmp_path)
    assert [method.name for method in plan.methods] == names
