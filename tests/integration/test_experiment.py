"""`voxdepth experiment` as a user meets it, and what each experiment finds on a few tiny frames."""

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from scenarios.experiments.frame_rate import SETUPS
from scenarios.experiments.runner import find_experiments, run
from tests.experiment_context import SEQUENCE, WIDTH_PX, small_context
from voxdepth.calibration import read
from voxdepth.networks import has_runtime
from voxdepth.tools.cli import create_app

FRAMES = 31
DEEP_SMOOTH = ["DS"] if has_runtime() else []
"""The method that needs the extra `learned`."""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the recording is shared."""
    return tmp_path_factory.mktemp("experiments")


def experiment(*arguments: str | Path) -> Result:
    """The command, in this process."""
    return CliRunner(env={"COLUMNS": "200"}).invoke(create_app(), ["experiment", *map(str, arguments)])


def asked(name: str, out: Path, frames: int = FRAMES) -> list[pd.DataFrame]:
    (one,) = find_experiments([name])
    found = run(one, small_context(out, frames), "").findings
    assert found.figure.startswith(b"\x89PNG")
    assert len(found.figure) < 500_000
    return list(found.tables.values())


def test_two_experiments_in_one_call_share_a_recording(out: Path) -> None:
    options = ("--sequences", SEQUENCE, "--width", WIDTH_PX, "--frames", 16, "--out", out)
    done = experiment("artefacts", "fps", *options)
    assert done.exit_code == 0, done.output
    for words in ("How do the errors of rendered depth compare", "islands", "one by one", "paper: "):
        assert words in done.output, words
    assert len(list((out / "recordings").iterdir())) == 1
    for name in ("artefacts", "fps"):
        assert {"table.csv", "figure.png", "result.json"} <= {path.name for path in (out / name).iterdir()}
        stored = json.loads((out / name / "result.json").read_text())
        assert (stored["name"], stored["frames"], stored["sequences"]) == (name, 16, [SEQUENCE])
        assert stored["provenance"]["processor"]


def test_confidence_is_fitted_where_there_are_fills_and_its_file_can_be_read(out: Path, tmp_path: Path) -> None:
    (one,) = find_experiments(["confidence"])
    result = one.answer(small_context(out, 3))
    table = result.tables["table"].set_index("corrector")
    own, fitted = (table[f"calibration error, {what} [%]"] for what in ("own", "fitted"))
    assert list(fitted.index[fitted.isna()]) == ["temporal"]
    assert list(fitted.index[fitted == own]) == ["raw"]
    ((name, content),) = result.files.items()
    (tmp_path / name).write_bytes(content)
    assert list(read(tmp_path / name)) == list(fitted.drop("temporal").index)


@pytest.mark.slow
def test_quality_has_the_papers_layout(out: Path) -> None:
    table, engaged, arithmetic = asked("quality", out)
    printed = [17.10, 17.10, None, None, 177.61, 17.10]
    pd.testing.assert_series_equal(table["VD (paper)"], pd.Series(printed, name="VD (paper)"))
    assert table["n"][0] < table["n"][1], "pixels after the warm-up, and all of them"
    assert list(engaged["method"]) == ["voxdepth", "voxdepth-authors"]
    assert table[["VD", "VD-code", "RS", "GS", *DEEP_SMOOTH]].notna().all(axis=None)
    assert len(arithmetic) == 14


def test_fps_leaves_out_the_warm_up(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rates = (rate for rate in (1000.0, 3.0, 1.0, 2.0) for _ in SETUPS)
    monkeypatch.setattr("scenarios.experiments.frame_rate.frame_rate", lambda *_: next(rates))
    (table,) = asked("fps", out, 16)
    spread = table.loc[0, ["median [frames/s]", "lowest [frames/s]", "highest [frames/s]", "n runs"]]
    assert list(spread) == [2.0, 1.0, 3.0, 3]


@pytest.mark.slow
def test_fps_times_every_way(out: Path) -> None:
    (table,) = asked("fps", out, 20)
    ways = ["VD", "VD-Nopipe", "VD-Nopipe, fusing beside", "VD-code", "RS", "GS", *DEEP_SMOOTH]
    assert list(table["method"]) == [*ways, "Swarm"]
    medians = table.set_index("method")["median [frames/s]"]
    assert (medians[ways] > 0).all()
    assert medians.isna()["Swarm"], "the paper quotes it, and nothing repeats it"
