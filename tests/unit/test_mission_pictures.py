"""The folder of a run, the map of its flight, and pictures of a drone."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.text import Annotation

from scenarios.config import Run, images_of, load_run
from scenarios.errors import ScenarioError
from scenarios.flight import Finished, fly
from scenarios.mission_pictures import flight_figure, take_picture
from scenarios.runner import LONGEST_CORRECTOR, _new_folder, fly_and_write, folder_name

QUICK = {"mission.drones": 2, "mission.duration_s": 0.5, **images_of(32, 32), "rig.depth": "truth"}


def run(name: str, **changes: object) -> Run:
    return load_run(name, 0, {**QUICK, "corrector": "raw", **changes})


def drawn(flown: Run, finished: Finished) -> tuple[Axes, list[str]]:
    """The map, and the words of its legend."""
    (axes,) = flight_figure(flown, finished).axes
    return axes, [text.get_text() for text in axes.get_legend().get_texts()]


@pytest.mark.parametrize("rig", [{"rig.color_offset_m": 0.06}, {"rig.shutter": 0.5}])
def test_drones_fly_by_their_left_camera(rig: dict[str, float]) -> None:
    with pytest.raises(ScenarioError, match="drones fly by their left camera; leave it out"):
        run("city", **rig)


@pytest.mark.parametrize("blank_share", [0.0, 1.0])
def test_drones_have_their_numbers_and_towers_without_texture_a_mark(blank_share: float) -> None:
    flown = run("city", **{"mission.drones": 3, "scene.blank_share": blank_share})
    finished = fly(flown)
    axes, words = drawn(flown, finished)
    ends = {text.get_text(): tuple(text.xy) for text in axes.texts if isinstance(text, Annotation)}
    assert ends == {str(k): tuple(t.position_m[-1, :2]) for k, t in enumerate(finished.result.trajectories)}
    hatched = sum(patch.get_hatch() is not None for patch in axes.patches)
    assert hatched >= 50 if blank_share else not hatched
    assert len(words) == len(set(words))
    assert ("without texture: stereo measures nothing" in words) == bool(blank_share)
    assert {"drone at the end, by its number", "goal"} <= set(words) and "collision" not in words


def test_the_folder_of_a_run_says_what_was_flown(tmp_path: Path) -> None:
    noisy = run("city", **{"rig.depth": "noisy", "rig.noise.scale.theta": 0.5, "corrector": "median"})
    assert folder_name(noisy) == "city-0-noisy0.5-median"
    config = {"fill": "none", "shadow_factor": 1.0, "smoothing_window_px": 3}
    set_up = folder_name(run("city", **{"corrector": {"name": "temporal", "config": config}}))
    assert re.fullmatch(rf"city-0-truth-temporal-fill-none[\w.-]{{,{LONGEST_CORRECTOR}}}", set_up)
    for _ in range(2):
        fly_and_write(run("crossing"), tmp_path, record=False)
    names = [folder.name for folder in tmp_path.iterdir()]
    assert len(names) == 2
    assert all(re.fullmatch(r"\d{8}-\d{6}-crossing-0-truth-raw(-2)?", name) for name in names)


def test_a_run_has_a_folder_of_its_own_and_none_without_files(tmp_path: Path) -> None:
    with _new_folder(tmp_path / "a" / "b", run("crossing")) as folder:
        assert folder.is_dir()
    assert not (tmp_path / "a").exists()
    with _new_folder(tmp_path / "a", run("crossing")) as folder:
        (folder / "config.toml").write_text("")
    assert (folder / "config.toml").exists()


def test_there_is_no_picture_of_a_drone_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match=r"expected a drone from 0 to 1, got 2"):
        take_picture(run("city"), tmp_path / "picture.jpg", drone=2, at_s=1.0)


def test_a_collision_is_a_red_cross_and_the_first_is_reported() -> None:
    through_a_tower = {"mission.routes": [{"start_m": [-8.0, 2.6, 6.0], "goal_m": [12.0, 2.6, 6.0]}]}
    reckless = {"mission.rules.avoidance": False, "mission.duration_s": 30.0, "mission.drones": 1}
    blind = run("city", **through_a_tower, **reckless)
    flown = fly(blind)
    (first,) = flown.result.contacts
    later = replace(first, other="later")
    axes, words = drawn(blind, replace(flown, result=replace(flown.result, contacts=(first, later))))
    notes = [text.get_text() for text in axes.texts if "hit" in text.get_text()]
    assert notes == [f"{first.time_s:.1f} s: drone 0 hit {first.other}"]
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert [line.get_color() for line in crosses] == ["red", "red"] and "collision" in words
    before = flown.result.trajectories[0].time_s <= first.time_s
    assert crosses[0].get_xydata()[0] == pytest.approx(flown.result.trajectories[0].position_m[before][-1, :2])
