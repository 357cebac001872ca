"""The map of a flight."""

from dataclasses import replace
from pathlib import Path

import cv2
import pytest

from scenarios.config import Run, images_of, load_run
from scenarios.mission_pictures import difficulty_of, draw_flight
from scenarios.runner import fly, fly_and_write

QUICK = {"mission.drones": 2, "mission.duration_s": 0.5, **images_of(32, 32), "rig.depth": "truth"}


def run(name: str, **changes: object) -> Run:
    return load_run(name, 0, {**QUICK, "corrector": "raw", **changes})


def test_more_things_on_the_way_make_a_place_harder() -> None:
    many, few = (difficulty_of(run("city", **{"scene.columns": n, "scene.poles": 2})) for n in (6, 1))
    assert many.bodies == 62
    assert few.bodies == 12
    assert many.traversability < few.traversability < 40


@pytest.mark.parametrize("name", ["crossing", "forest"])
def test_a_flight_is_drawn(tmp_path: Path, name: str) -> None:
    flown = run(name)
    draw_flight(tmp_path / "map.png", flown, fly(flown))
    image = cv2.imread(str(tmp_path / "map.png"))
    assert image is not None
    blue, green, red = (image[..., channel].astype(int) for channel in range(3))
    assert ((red > 200) & (blue < 60)).any(), "leaders are orange"
    assert ((green > 120) & (red < 80)).any(), "goals are green"


def test_a_run_leaves_its_picture_with_or_without_a_recording(tmp_path: Path) -> None:
    folder = fly_and_write(run("crossing"), tmp_path, record=False).folder
    assert folder is not None
    assert 10_000 < (folder / "flight.png").stat().st_size < 300_000
    assert not (folder / "run.rrd").exists()


def test_a_collision_is_a_red_cross(tmp_path: Path) -> None:
    through_a_tower = {"mission.routes": [{"start_m": [-8.0, 2.6, 6.0], "goal_m": [12.0, 2.6, 6.0]}]}
    reckless = {"mission.rules.avoidance": False, "mission.duration_s": 30.0, "mission.drones": 1}
    blind = run("city", **through_a_tower, **reckless)
    flown = fly(blind)
    assert flown.result.contacts
    draw_flight(tmp_path / "hit.png", blind, flown)
    draw_flight(tmp_path / "missed.png", blind, replace(flown, result=replace(flown.result, contacts=())))
    assert pure_red(tmp_path / "hit.png") > 30
    assert pure_red(tmp_path / "missed.png") == 0


def pure_red(path: Path) -> int:
    """Number of pixels of the colour of collisions."""
    image = cv2.imread(str(path))
    assert image is not None
    return int((image == (0, 0, 255)).all(axis=2).sum())
