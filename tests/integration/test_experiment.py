"""`voxdepth experiment` as a user meets it, and what each experiment finds on a few tiny frames."""

import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from scenarios.experiments.runner import find_experiments
from tests.experiment_context import SEQUENCE, WIDTH_PX, small_context
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


@pytest.mark.slow
def test_two_experiments_in_one_call_share_a_recording(out: Path) -> None:
    options = ("--sequences", SEQUENCE, "--width", WIDTH_PX, "--frames", FRAMES, "--out", out)
    done = experiment("artefacts", "quality", *options)
    assert done.exit_code == 0, done.output
    for words in ("How do the errors of rendered depth compare", "islands", "paper: of VD, RS and GS"):
        assert words in done.output, words
    assert len(list((out / "recordings").iterdir())) == 1
    for name in ("artefacts", "quality"):
        stored = json.loads((out / name / "result.json").read_text())
        assert (stored["name"], stored["frames"], stored["sequences"]) == (name, FRAMES, [SEQUENCE])
        assert stored["provenance"]["processor"]
        assert 10_000 < (out / name / "figure.png").stat().st_size < 500_000
    table = pd.read_csv(out / "quality" / "table.csv")
    pd.testing.assert_series_equal(table["VD (paper)"], pd.Series([17.10, None], name="VD (paper)"))
    assert table["n"][0] > table["n"][1] > 0, "all pixels, and occluded pixels"
    assert table[["VD", "VD-code", "RS", "GS", *DEEP_SMOOTH]].notna().all(axis=None)


def test_confidence_is_fitted_where_there_are_fills_and_its_file_can_be_read(out: Path, tmp_path: Path) -> None:
    (one,) = find_experiments(["confidence"])
    result = one.answer(small_context(out, 3))
    assert "Fitted to seed 101" in result.notes[0]
    shares = result.table.set_index("corrector")
    assert not shares.loc["raw"].any() and shares.loc["telea", "inpainted"] > 0
    ((name, content),) = result.files.items()
    (tmp_path / name).write_bytes(content)
    assert {
        of: fills.get("inpainted", 0) for of, fills in tomllib.loads((tmp_path / name).read_text()).items()
    } == dict(shares["inpainted"])
