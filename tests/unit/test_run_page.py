"""The page of a run."""

import base64
import io
import json
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure
from rich.console import Console

from scenarios import runner
from scenarios.config import images_of, load_run
from scenarios.flight import Finished, fly
from scenarios.report import drone_table, print_summary, summary_tables
from scenarios.runner import fly_and_write
from swarm.types import MissionResult, Outcome

QUICK = {"mission.drones": 2, "mission.duration_s": 0.5, **images_of(32, 32), "rig.depth": "truth", "corrector": "raw"}


def test_a_run_leaves_a_page_that_needs_nothing_else(tmp_path: Path) -> None:
    run = load_run("city", 3, QUICK)
    folders = [fly_and_write(run, tmp_path / name, record=False).folder for name in ("first", "second")]
    pages = [(folder / "summary.html").read_text() for folder in folders if folder is not None]
    assert pages[0] == pages[1], "the same run gives the same page"
    assert folders[0] is not None
    assert json.loads((folders[0] / "metrics.json").read_text())["seed"] == 3
    for text in ("city, seed 3: depth truth, corrector raw", "<b>timeout</b>", "voxdepth run config.toml", "numpy"):
        assert text in pages[0]
    assert "run.rrd" not in pages[0], "there is no recording"
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', pages[0])
    assert base64.b64decode(picture) == (folders[0] / "flight.png").read_bytes()
    assert not re.search(r'(?:src|href)="(?!data:)', pages[0])


def test_the_end_of_every_drone_stands_on_the_page_and_the_terminal(tmp_path: Path) -> None:
    changes = {"mission.drones": 3, "mission.duration_s": 0.5, "mission.after_contact": "drop"}
    run = load_run("city", 3, QUICK | changes)
    finished = fly_and_write(run, tmp_path, record=False)
    hit = {"end": "hit a drone", "hit": "drone-2", "first_contact_m": 31.25}
    drones = [dict(drone) for drone in finished.result.drones]
    assert [(drone["end"], drone["hit"]) for drone in drones] == [("out of time", None)] * 3
    table = drone_table([drones[0], drones[1] | hit, drones[2] | {"end": "arrived"}])
    assert [row[:3] for row in table.texts] == [
        ["0", "leader", "out of time"],
        ["1", "follower", "hit a drone (drone-2) after 31.25 m"],
        ["2", "follower", "arrived"],
    ]
    console = Console(file=io.StringIO(), width=200)
    print_summary(console, finished, run)
    page = (finished.folder / "summary.html").read_text()
    for text in (console.file.getvalue(), page):
        assert "How the drones ended" in text
        assert text.count("out of time") == 3
        assert "0 of 3" in text


def test_depth_that_is_too_far_and_holes_have_their_columns() -> None:
    run = load_run("city", 3, QUICK)
    metrics = {**fly(run).result.metrics, "depth_raw_too_far_share": 0.25, "depth_raw_hole_share": 0.5}
    result = MissionResult(outcome=Outcome.TIMEOUT, contacts=(), trajectories=(), metrics=metrics)
    *_, depth = summary_tables(Finished(result=result, wall_s=1.0, folder=None), run)
    assert depth.texts[0][2:] == ["25.0 %", "50.0 %"]


@pytest.mark.parametrize(("window", "passed", "ends"), [(4, True, 1), (1, False, 2)])
def test_a_flight_counts_epochs_and_warns_if_frames_mostly_pass_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, window: int, passed: bool, ends: int
) -> None:
    monkeypatch.setattr(runner, "flight_figure", lambda *_: Figure())
    corrector = {"name": "voxdepth", "config": {"window_frames": window, "fusion_lag_frames": 0, "max_epoch_frames": 2}}
    changes = QUICK | images_of(96, 54) | {"corrector": corrector, "mission.cruise_speed_m_s": 1e-6}
    run = load_run("city", 3, changes)
    finished = fly_and_write(run, tmp_path, record=False)
    share = finished.result.metrics["corrector_phase_passthrough_share"]
    assert share == (window - 1) / 5
    assert finished.result.metrics["corrector_epoch_ends_max_frames"] == 2 * ends
    console = Console(file=io.StringIO(), width=200)
    print_summary(console, finished, run)
    printed = console.file.getvalue()
    assert ("warning: 60.0 % of the frames passed through without a template" in printed) == passed
    page = (finished.folder / "summary.html").read_text()
    assert page.count("corrector_phase_passthrough_share") == page.count("corrector_epoch_ends_max_frames") == 1
