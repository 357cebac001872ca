"""`voxdepth experiment` as a user meets it, and what each experiment finds on a few tiny frames."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from scenarios.experiments.runner import ALL, EXPERIMENTS, find_experiments
from tests.experiment_context import SEQUENCE, WIDTH_PX, small_context
from tests.integration.test_cli import voxdepth
from voxdepth.calibration import read
from voxdepth.networks import has_runtime
from voxdepth.tools.cli import create_app
from voxdepth.tools.table import Table

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


def asked(name: str, out: Path, frames: int = FRAMES) -> tuple[Table, ...]:
    (one,) = find_experiments([name])
    result = one.answer(small_context(out, frames))
    assert result.figure.startswith(b"\x89PNG")
    assert len(result.figure) < 500_000
    return result.tables


def test_two_experiments_in_one_call_share_a_recording(out: Path) -> None:
    options = ("--sequences", SEQUENCE, "--width", WIDTH_PX, "--frames", FRAMES, "--out", out)
    done = experiment("rq3", "rq4", *options)
    assert done.exit_code == 0, done.output
    for words in ("Templates of the same windows", "dilation", "Farneback", "paper: "):
        assert words in done.output, words
    assert len(list((out / "recordings").iterdir())) == 1
    for name in ("rq3", "rq4"):
        assert {"table.csv", "figure.png", "result.json"} <= {path.name for path in (out / name).iterdir()}
        stored = json.loads((out / name / "result.json").read_text())
        assert (stored["name"], stored["frames"], stored["sequences"]) == (name, FRAMES, [SEQUENCE])
        assert stored["provenance"]["processor"]


def test_the_help_names_every_experiment() -> None:
    text = experiment("--help").output
    assert all(name in text for name in (*EXPERIMENTS, ALL))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["rq5"], "there is no experiment 'rq5'; choose one or more of: rq1, rq2"),
        (["rq1", "--sequences", "sim-XX"], "there is no sequence 'sim-XX'"),
        (["window", "--frames", "9"], "window needs at least 17 frames of each sequence, got --frames 9"),
        (["rq1", "--width", "9999"], "--width must be 64 to 2048 pixels, got 9999"),
        (["rq1", "--out", "file/below"], "cannot write"),
    ],
)
def test_bad_input_is_one_line_and_exit_2(arguments: list[str], message: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = voxdepth("experiment", *arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert message in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_rq1_grows_what_is_occluded(out: Path) -> None:
    table, doses = asked("rq1", out, 3)
    occluded, psnrs_db = ([float(str(value)) for value in doses.column(name)] for name in ("occluded", "PSNR"))
    assert occluded == sorted(occluded)
    assert psnrs_db[-1] < psnrs_db[0]
    assert table.column("n frames") == [3]


def test_rq4_counts_pairs_and_moves_better_than_not_at_all(out: Path) -> None:
    (table,) = asked("rq4", out)
    rows = [dict(zip([column.name for column in table.columns], row, strict=True)) for row in table.rows]
    assert {row["distance"] for row in rows} == {1, 3, 10, 25}
    ten = {row["method"]: row for row in rows if row["distance"] == 10}
    assert {row["n pairs"] for row in ten.values()} == {4}
    assert len({row["n pixels"] for row in ten.values()}) == 1, "all are judged on the same pixels"
    unmoved = ten.pop("unmoved")
    assert all(float(row["gray PSNR"]) > float(unmoved["gray PSNR"]) for row in ten.values())


def test_steps_follow_one_frame_through_the_stages(out: Path) -> None:
    (table,) = asked("steps", out, 16)
    filled = dict(zip(table.column("stage"), table.column("with depth"), strict=True))
    assert filled["voxel projection"] < filled["template"]  # type: ignore[operator]
    assert filled["as measured"] < filled["result"] <= filled["truth"] == 100  # type: ignore[operator]
    assert {"VD: voxdepth", "VD-code: voxdepth-authors", "RS: realsense-left"} <= set(filled)


def test_components_are_the_steps_of_the_corrector(out: Path) -> None:
    (table,) = asked("components", out, 16)
    n, p50_ms = (dict(zip(table.column("component"), table.column(name), strict=True)) for name in ("n", "p50"))
    assert list(n) == ["fusion", "inpainting", "transform", "combine"]
    assert n["transform"] == n["combine"] > n["fusion"] == n["inpainting"] >= 1
    assert p50_ms["fusion"] > p50_ms["inpainting"] > 0


def test_confidence_is_fitted_where_there_are_fills_and_its_file_can_be_read(out: Path, tmp_path: Path) -> None:
    (one,) = find_experiments(["confidence"])
    result = one.answer(small_context(out, 3))
    (table,) = result.tables
    own, fitted = (dict(zip(table.column("corrector"), table.column(f"calibration error, {what}"), strict=True))
                   for what in ("own", "fitted"))  # fmt: skip
    assert fitted.pop("temporal") is None
    assert fitted["raw"] == own["raw"]
    assert all(fitted[name] != own[name] for name in fitted if name != "raw")
    ((name, content),) = result.files.items()
    (tmp_path / name).write_bytes(content)
    assert list(read(tmp_path / name)) == list(fitted)


@pytest.mark.slow
def test_default_has_every_measure(out: Path) -> None:
    (one,) = find_experiments(["default"])
    result = one.answer(small_context(out, 3))
    criteria, holes, *_ = result.tables
    assert all(str(outcome).startswith(("held", "missed by", "not measured")) for outcome in criteria.column("outcome"))
    assert holes.column("sequence") == [SEQUENCE]


@pytest.mark.slow
def test_ablation_judges_every_variant(out: Path) -> None:
    means, each = asked("ablation", out, 3)
    assert means.column("variant") == each.column("variant")
    assert all(isinstance(value, float) for value in means.column("measured RMSE"))
    by_variant = dict(zip(means.column("variant"), means.column("measured RMSE"), strict=True))
    assert by_variant["single-frame"] != by_variant["temporal"]


@pytest.mark.slow
def test_rq2_judges_every_size(out: Path) -> None:
    (table,) = asked("rq2", out)
    assert table.column("size") == ["unmoved", "100", "150", "200", "300", "400", "600"]
    assert table.column("corrected PSNR")[0] is None
    assert all(isinstance(value, float) for value in table.column("corrected PSNR")[1:])


@pytest.mark.slow
def test_quality_has_the_papers_layout(out: Path) -> None:
    table, engaged, arithmetic = asked("quality", out)
    printed = [17.10, 17.10, None, None, 177.61, 17.10]
    assert table.column("VD (paper)") == printed, "of the dataset that sim-MB stands for"
    assert table.column("n")[0] < table.column("n")[1], "pixels after the warm-up, and all of them"  # type: ignore[operator]
    assert engaged.column("method") == ["voxdepth", "voxdepth-authors"]
    assert all(
        isinstance(value, float) for name in ("VD", "VD-code", "RS", "GS", *DEEP_SMOOTH) for value in table.column(name)
    )
    assert len(arithmetic.rows) == 14


@pytest.mark.slow
def test_fps_times_every_way(out: Path) -> None:
    (table,) = asked("fps", out, 20)
    assert table.column("method") == [
        "VD",
        "VD-Nopipe",
        "VD-Nopipe, fusing beside",
        "VD-code",
        "RS",
        "GS",
        *DEEP_SMOOTH,
        "Swarm",
    ]
    *medians, quoted = table.column("median")
    assert all(isinstance(value, float) and value > 0 for value in medians)
    assert quoted is None, "the paper quotes it, and nothing repeats it"


@pytest.mark.slow
def test_window_judges_the_same_frames_for_all_sizes(out: Path) -> None:
    (table,) = asked("window", out)
    assert table.column("window") == [2, 4, 6, 8, 10, 12]
    assert set(table.column("n frames judged")) == {FRAMES - 16}


@pytest.mark.slow
def test_switches_counts_and_pairs(out: Path) -> None:
    ends, movement = asked("switches", out)
    assert ends.column("n frames") == [FRAMES]
    assert movement.column("distance") == [10]
