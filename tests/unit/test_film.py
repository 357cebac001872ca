"""Films of missions."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scenarios.config import images_of, load_run
from scenarios.errors import ScenarioError
from scenarios.film import EYE_M, LOOK_AT_M, STEP_S, draw_world, faces_of, make_film
from scenarios.images import drone_color
from sim.bodies import Body, Box, Scene, Surface

QUICK = {"mission.drones": 2, **images_of(32, 32), "rig.depth": "truth", "corrector": "raw"}


def test_a_film_shows_every_drone_in_its_colour(tmp_path: Path) -> None:
    path = tmp_path / "film.gif"
    make_film(load_run("city", 0, QUICK), path, drone=0, until_s=3 * STEP_S)
    with Image.open(path) as film:
        assert film.n_frames >= 3
        for frame in range(film.n_frames):
            film.seek(frame)
            image = np.array(film.convert("RGB"))
            for drone in range(2):
                assert (image == drone_color(drone)).all(axis=2).sum() > 20, (frame, drone)


@pytest.mark.parametrize(
    ("name", "drone", "message"), [("film.jpg", 0, "must be a .gif file"), ("film.gif", 2, "from 0 to 1, got 2")]
)
def test_a_film_that_cannot_be_made_is_refused(tmp_path: Path, name: str, drone: int, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        make_film(load_run("city", 0, QUICK), tmp_path / name, drone=drone, until_s=1.0)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_near_bodies_hide_far_ones(order: tuple[int, int]) -> None:
    """Along the line of sight there is a bright box, and a dark one behind it."""
    ahead = LOOK_AT_M - EYE_M
    boxes = [
        Body(
            name=f"box {albedo}",
            shape=Box(size_m=(2.0, 2.0, 2.0)),
            position_m=tuple(EYE_M + share * ahead),
            surface=Surface(albedo=albedo),
        )
        for albedo, share in ((1.0, 0.5), (0.0, 0.9))
    ]
    faces = faces_of(Scene(seed=0, bodies=tuple(boxes[i] for i in order)))
    image = draw_world(faces, [np.array([[0.0, 500.0, 0.0]])], np.zeros(3))
    rows, cols, _ = image.shape
    assert image[rows // 2, cols // 2].min() > 110
    assert faces.shade.min() < 0.3
