"""The map of a flight."""

from pathlib import Path

import cv2
import pytest

from scenarios.config import Run, images_of, load_run
from scenarios.mission_pictures import difficulty_of, draw_flight
from scenarios.runner import fly

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
