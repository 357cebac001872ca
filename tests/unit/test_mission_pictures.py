"""The map of a flight."""

import re
from dataclasses import replace
from pathlib import Path

import cv2
import pytest
from matplotlib.text import Annotation

from scenarios.config import Run, images_of, load_run
from scenarios.errors import ScenarioError
from scenarios.flight import fly
from scenarios.mission_pictures import draw_flight, flight_figure, take_picture
from scenarios.runner import LONGEST_CORRECTOR, _new_folder, fly_and_write, folder_name

QUICK = {"mission.drones": 2, "mission.duration_s": 0.5, **images_of(32, 32), "rig.depth": "truth"}


def run(name: str, **changes: object) -> Run:
    return load_run(name, 0, {**QUICK, "corrector": "raw", **changes})


@pytest.mark.parametrize("rig", [{"rig.color_offset_m": 0.06}, {"rig.shutter": 0.5}])
def test_drones_fly_by_their_left_camera(rig: dict[str, float]) -> None:
    with pytest.raises(ScenarioError, match="drones fly by their left camera; leave it out"):
        run("city", **rig)


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Folders of the same run, flown twice."""
    out = tmp_path_factory.mktemp("runs")
    written = [fly_and_write(run("crossing"), out, record=False).folder for _ in range(2)]
    return [folder for folder in written if folder is not None]


def test_a_flight_is_drawn_with_or_without_a_recording(folders: list[Path], tmp_path: Path) -> None:
    assert not (folders[0] / "run.rrd").exists()
    flown = run("corridor")
    draw_flight(tmp_path / "map.png", flown, fly(flown))
    for path in (folders[0] / "flight.png", tmp_path / "map.png"):
        image = cv2.imread(str(path))
        assert 10_000 < path.stat().st_size < 300_000
        blue, green, red = (image[..., channel].astype(int) for channel in range(3))
        assert ((red > 200) & (blue < 60)).any(), "leaders are orange"
        assert ((green > 120) & (red < 80)).any(), "goals are green"


@pytest.mark.parametrize("blank_share", [0.0, 1.0])
def test_drones_have_their_numbers_and_towers_without_texture_a_mark(blank_share: float) -> None:
    flown = run("city", **{"mission.drones": 3, "scene.blank_share": blank_share})
    finished = fly(flown)
    figure = flight_figure(flown, finished)
    (axes,) = figure.axes
    ends = {text.get_text(): tuple(text.xy) for text in axes.texts if isinstance(text, Annotation)}
    assert ends == {str(k): tuple(t.position_m[-1, :2]) for k, t in enumerate(finished.result.trajectories)}
    hatched = sum(patch.get_hatch() is not None for patch in axes.patches)
    assert hatched >= 50 if blank_share else not hatched
    legend = axes.get_legend()
    words = [text.get_text() for text in legend.get_texts()]
    assert len(words) == len(set(words))
    assert ("without texture: stereo measures nothing" in words) == bool(blank_share)
    assert {"drone at the end, by its number", "goal"} <= set(words) and "collision" not in words


def test_the_folder_of_a_run_says_what_was_flown(folders: list[Path]) -> None:
    noisy = run("city", **{"rig.depth": "noisy", "rig.noise.scale.theta": 0.5, "corrector": "median"})
    assert folder_name(noisy) == "city-0-noisy0.5-median"
    config = {"fill": "none", "shadow_factor": 1.0, "smoothing_window_px": 3}
    set_up = folder_name(run("city", **{"corrector": {"name": "temporal", "config": config}}))
    assert re.fullmatch(rf"city-0-truth-temporal-fill-none[\w.-]{{,{LONGEST_CORRECTOR}}}", set_up)
    names = [folder.name for folder in folders]
    assert len(set(names)) == 2
    assert all(re.fullmatch(r"\d{8}-\d{6}-crossing-0-truth-raw(-2)?", name) for name in names)


def test_a_run_has_a_folder_of_its_own_and_none_without_files(tmp_path: Path) -> None:
    with _new_folder(tmp_path / "a" / "b", run("crossing")) as folder:
        assert folder.is_dir()
    assert not (tmp_path / "a").exists()
    with _new_folder(tmp_path / "a", run("crossing")) as folder:
        (folder / "config.toml").write_text("")
    assert (folder / "config.toml").exists()


def test_there_is_no_picture_of_a_drone_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"expected a drone from 0 to 1, got 20"):
        take_picture(run("city"), tmp_path / "picture.jpg", drone=20, at_s=1.0)


def test_a_collision_is_a_red_cross(folders: list[Path], tmp_path: Path) -> None:
    through_a_tower = {"mission.routes": [{"start_m": [-8.0, 2.6, 6.0], "goal_m": [12.0, 2.6, 6.0]}]}
    reckless = {"mission.rules.avoidance": False, "mission.duration_s": 30.0, "mission.drones": 1}
    blind = run("city", **through_a_tower, **reckless)
    flown = fly(blind)
    assert flown.result.contacts
    draw_flight(tmp_path / "hit.png", blind, flown)
    assert pure_red(tmp_path / "hit.png") > 30
    assert pure_red(folders[0] / "flight.png") == 0
    first = flown.result.contacts[0]
    for other, kind in (("tower-0-4", "building"), ("ground", "ground"), ("mover-2", "mover")):
        contacts = (replace(first, other=other, kind=kind), replace(first, other="later"))
        (axes,) = flight_figure(blind, replace(flown, result=replace(flown.result, contacts=contacts))).axes
        notes = [text.get_text() for text in axes.texts if "hit" in text.get_text()]
        assert notes == [f"{first.time_s:.1f} s: drone 0 hit {other}"]


def pure_red(path: Path) -> int:
    """Number of pixels of the colour of collisions."""
    image = cv2.imread(str(path))
    return int((image == (0, 0, 255)).all(axis=2).sum())
