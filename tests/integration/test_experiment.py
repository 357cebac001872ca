"""What each experiment finds on a few tiny frames, and `voxdepth experiment` as a user meets it."""

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest

from scenarios.errors import ScenarioError
from scenarios.experiments.catalogue import CATALOGUE
from scenarios.experiments.experiment import Experiment
from scenarios.experiments.measures import collisions
from scenarios.experiments.runner import find_experiment
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from tests.commands import invoke
from tests.studies import fake, unseen
from tests.unit.test_datasets_midair import TRAJECTORY, write_colour, write_float16
from voxdepth.networks import has_runtime

SEQUENCE, FRAMES, WIDTH_PX = "sim-MB", 18, 160
FEWER: dict[str, dict[str, Any]] = {
    "fps": {"RUNS": 1},
    "rq2": {"SIZES_PX": (200, 600)},
    "window": {"SIZES": (10, 12)},
}
"""Repetitions and settings that say nothing more in a test."""
DEEP_SMOOTH = ["DS"] if has_runtime() else []
"""The method that needs the extra `learned`."""


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of all results, in which the recording is made once."""
    return tmp_path_factory.mktemp("results")


def small(name: str, out: Path) -> Experiment:
    """An experiment on a few tiny frames, which reports to nobody."""
    given = {"sequences": (SEQUENCE,), "frames": FRAMES, "width_px": WIDTH_PX}
    experiment = find_experiment(name)
    return experiment.with_options(out=out, report=unseen, **given if experiment.sequences else {})


@pytest.mark.parametrize("name", [name for name in CATALOGUE if name not in ("collide", "steps", "quality")])
def test_an_experiment_answers_on_a_few_frames_with_a_table_a_picture_and_claims(
    name: str, out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = small(name, out)
    for constant, value in FEWER.get(name, {}).items():
        monkeypatch.setattr(import_module(f"scenarios.experiments.{name}"), constant, value)
    findings = experiment.answer(experiment)
    assert len(findings.table) and not findings.table.columns.duplicated().any()
    assert findings.figure is not None and cv2.imdecode(np.frombuffer(findings.figure, np.uint8), cv2.IMREAD_COLOR).size
    for claim in experiment.claims(findings.table):
        assert claim.paper and claim.found and claim.agrees_if
    assert len(list((out / "recordings").iterdir() if (out / "recordings").exists() else ())) <= 1


def test_the_steps_are_shown_from_the_sparse_projection_to_every_rival(out: Path) -> None:
    experiment = small("steps", out)
    findings = experiment.answer(experiment)
    table = findings.table.set_index("step")
    assert findings.figure and [claim.verdict for claim in experiment.claims(findings.table)] != ["open"]
    shown = ["its depth", "sparse projection", "template", "aligned template", "result", "truth", "raw"]
    rivals = ["RS: realsense-left", "GS: lmeds", "VD-code: voxdepth-authors", "VD: voxdepth", "temporal"]
    assert {*shown, *rivals} <= {*table.index}
    filled = table["with depth [%]"]
    assert filled["sparse projection"] < filled["template"] and filled["truth"] == 100


def test_collisions_are_read_from_a_store_or_flown_and_then_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[str] = []
    monkeypatch.setattr(collisions, "Processes", lambda *_: Serial(lambda spec: flown.append(spec.key) or fake(spec)))
    experiment = find_experiment("collide").with_options(out=tmp_path, frames=2, report=unseen)
    first = experiment.answer(experiment).table
    assert len(flown) == 10 and list(first["n runs"]) == [2] * 5
    pd.testing.assert_frame_equal(experiment.answer(experiment).table, first)
    assert len(flown) == 10, "what is stored is not flown again"
    store = tmp_path / "store"
    run_study(collisions.small_study(3), store, Serial(fake), unseen)
    stored = experiment.with_options(data=(store,))
    assert list(stored.answer(stored).table["n runs"]) == [3] * 5
    with pytest.raises(ScenarioError, match="expected one store of the study noise, got 2"):
        replace(experiment, data=(store, store)).answer(replace(experiment, data=(store, store)))


def write_trajectory(folder: Path, frames: int) -> None:
    """A wall of half the image before another one, moving to the left, of which the disparity lacks some."""
    for k in range(frames):
        write_colour(folder, k, 90 + k)
        disparity_px = np.where(np.arange(16) < 6, 4.0, 2.0)
        row, col = np.mgrid[:16, :16]
        ray = np.sqrt(((col - 8) / 8) ** 2 + ((row - 8) / 8) ** 2 + 1)
        write_float16(folder / f"depth/{TRAJECTORY}/{k:06d}.PNG", 8 / disparity_px * ray)
        write_float16(
            folder / f"stereo_disparity/{TRAJECTORY}/{k:06d}.PNG", np.where(np.arange(16) == 6, 0, disparity_px)
        )


def test_a_trajectory_of_mid_air_is_evaluated_in_place_of_the_sequences(tmp_path: Path) -> None:
    write_trajectory(tmp_path / "KTS", FRAMES)
    experiment = find_experiment("quality").with_options(
        out=tmp_path, frames=100, report=unseen, data=(tmp_path / "KTS",)
    )
    table = experiment.answer(experiment).table
    assert set(table["sequence"]) == {"KTS"}, "all of its frames, and no rendered sequence"
    psnr, masked, _ = (row for _, row in table.iterrows())
    assert psnr["VD (paper)"] == 17.69 and psnr["n"] == 2 * 16 * 16 and masked["n"] == 2 * 16
    assert psnr["raw"] > 30 and masked["raw"] < 3, "only the column beside the nearer wall is missing"


def test_a_trajectory_that_ends_before_the_first_template_is_refused(tmp_path: Path) -> None:
    write_trajectory(tmp_path / "short", 3)
    experiment = find_experiment("quality").with_options(out=tmp_path, report=unseen, data=(tmp_path / "short",))
    with pytest.raises(ScenarioError, match="expected at least 17 frames in short, got 3"):
        experiment.answer(experiment)


def test_quality_is_reported_beside_the_paper_s_and_recordings_are_kept(out: Path) -> None:
    options = ("--sequences", f"{SEQUENCE}, {SEQUENCE}", "--width", WIDTH_PX, "--frames", FRAMES, "--out", out)
    done = invoke("experiment", "quality", *options)
    assert done.exit_code == 0, done.output
    assert "paper: of VD, RS and GS, VD has the highest PSNR in 1 of 1" in done.output
    assert len(list((out / "recordings").iterdir())) == 1, "all experiments share the recording"
    folder = out / "quality"
    stored = json.loads((folder / "result.json").read_text())
    options = stored["options"]
    assert (stored["name"], options["frames"], options["sequences"]) == ("quality", FRAMES, [SEQUENCE])
    assert 10_000 < (folder / "figure.png").stat().st_size < 500_000
    table = pd.read_csv(folder / "table.csv")
    assert table["VD (paper)"].tolist()[0] == 17.10 and table["VD (paper)"][1:].isna().all()
    assert table["n"][0] > table["n"][1] > 0, "all pixels, and occluded pixels"
    assert table[["VD", "VD-code", "RS", "GS", *DEEP_SMOOTH]][:2].notna().all(axis=None)
