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
    options = ("--sequences", SEQUENCE, "--width", WIDTH_PX, "--frames", FRAMES, "--out", out)
    done = experiment("rq3", "rq4", *options)
    assert done.exit_code == 0, done.output
    for words in ("Which inpainting method", "dilation", "Farneback", "paper: "):
        assert words in done.output, words
    assert len(list((out / "recordings").iterdir())) == 1
    methods = pd.read_csv(out / "rq3" / "table.csv")["method"]
    assert list(methods[:3]) == ["as projected", "dilation", "bilinear"], "in the order of the paper"
    for name in ("rq3", "rq4"):
        assert {"table.csv", "figure.png", "result.json"} <= {path.name for path in (out / name).iterdir()}
        stored = json.loads((out / name / "result.json").read_text())
        assert (stored["name"], stored["frames"], stored["sequences"]) == (name, FRAMES, [SEQUENCE])
        assert stored["provenance"]["processor"]


def test_rq1_grows_what_is_occluded(out: Path) -> None:
    table, doses = asked("rq1", out, 3)
    assert doses["occluded [%]"].is_monotonic_increasing
    assert doses["PSNR [dB]"].iloc[-1] < doses["PSNR [dB]"].iloc[0]
    assert list(table["n frames"]) == [3]


def test_rq4_counts_pairs_and_moves_better_than_not_at_all(out: Path) -> None:
    (table,) = asked("rq4", out)
    assert set(table["distance [frames]"]) == {1, 3, 10, 25}
    ten = table[table["distance [frames]"] == 10].set_index("method")
    assert set(ten["n pairs"]) == {4}
    assert ten["n pixels"].nunique() == 1, "all are judged on the same pixels"
    gray_db = ten["gray PSNR [dB]"]
    assert (gray_db.drop("unmoved") > gray_db["unmoved"]).all()


def test_steps_follow_one_frame_through_the_stages(out: Path) -> None:
    (table,) = asked("steps", out, 16)
    filled = table.set_index("stage")["with depth [%]"]
    assert filled["voxel projection"] < filled["template"]
    assert filled["as measured"] < filled["result"] <= filled["truth"] == 100
    assert {"VD: voxdepth", "VD-code: voxdepth-authors", "RS: realsense-left"} <= set(filled.index)


def test_components_are_the_steps_of_the_corrector(out: Path) -> None:
    (table,) = asked("components", out, 16)
    n, p50_ms = (table.set_index("component")[name] for name in ("n", "p50 [ms]"))
    assert list(n.index) == ["fusion", "inpainting", "transform", "combine"]
    assert n["transform"] == n["combine"] > n["fusion"] == n["inpainting"] >= 1
    assert p50_ms["fusion"] > p50_ms["inpainting"] > 0


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
def test_default_judges_every_criterion_and_has_the_report(out: Path) -> None:
    (one,) = find_experiments(["default"])
    result = one.answer(small_context(out, 3))
    assert result.tables["table"]["outcome"].str.match("held|missed by|not measured").all()
    assert SEQUENCE in result.files["report.html"].decode()


@pytest.mark.slow
def test_ablation_judges_every_variant(out: Path) -> None:
    means, each = asked("ablation", out, 3)
    assert list(means["variant"]) == list(each["variant"])
    rmse_m = means.set_index("variant")["measured RMSE [m]"]
    assert rmse_m.notna().all() and rmse_m["temporal[smoothing_window_px=1]"] != rmse_m["temporal"]


@pytest.mark.slow
def test_rq2_judges_every_size(out: Path) -> None:
    (table,) = asked("rq2", out)
    assert list(table["size [px]"]) == ["unmoved", "100", "150", "200", "300", "400", "600"]
    assert list(table["corrected PSNR [dB]"].isna()) == [True, *[False] * 6]


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


@pytest.mark.slow
def test_window_judges_the_same_frames_for_all_sizes(out: Path) -> None:
    (table,) = asked("window", out)
    assert list(table["window [frames]"]) == [2, 4, 6, 8, 10, 12]
    assert table["n pixels"].nunique() == 1 and table["PSNR [dB]"].nunique() > 1


@pytest.mark.slow
def test_switches_counts_and_pairs(out: Path) -> None:
    ends, movement = asked("switches", out)
    assert list(ends["n frames"]) == [FRAMES]
    assert list(movement["distance [frames]"]) == [10]
