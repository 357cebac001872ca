"""Laws of what shaded pictures look like."""

import dataclasses
from typing import get_args

import numpy as np
import pytest

from sim.bodies import Body, Box, Pattern, Scene, Surface, Weather
from sim.render import create_renderer
from sim.types import VelocityCommand
from sim.world import World
from tests.helpers import CAMERA, block, camera_at, wall, world_of

FLOOR = Body(
    name="floor",
    kind="ground",
    shape=Box((60.0, 60.0, 1.0)),
    position_m=(0.0, 0.0, -2.5),
    surface=Surface(albedo=0.4, texture=0.0),
)


def gray_of(*bodies: Body, weather: Weather) -> np.ndarray:
    with World(Scene(seed=1, bodies=bodies, weather=weather), np.empty((0, 3))) as world:
        return create_renderer("raycast", world).render([camera_at(0, 0, 0)])[0].gray.astype(float)


def test_shadows_darken_what_the_sun_does_not_reach_and_nothing_else() -> None:
    box = block(6.0, 2.0)
    from_the_left = {"sun_azimuth_deg": 90.0, "sun_elevation_deg": 45.0}
    lit = gray_of(FLOOR, box, weather=Weather(**from_the_left))
    shaded = gray_of(FLOOR, box, weather=Weather(shadows=True, **from_the_left))
    assert (shaded <= lit).all()
    darker = shaded < lit - 5
    assert 0.005 < darker.mean() < 0.2
    assert darker[:, 80:].sum() > 20 * darker[:, :60].sum(), "the sun is on the left, so the shadow is on the right"
    floor = np.isclose(lit, np.median(lit[100:]), atol=3)
    ambient = Weather().ambient
    share = ambient / (ambient + (1 - ambient) * np.sin(np.radians(45)))
    assert shaded[darker & floor].mean() == pytest.approx(lit[darker & floor].mean() * share, rel=0.1)


def test_an_overcast_sky_casts_no_shadow() -> None:
    one, other = (gray_of(FLOOR, block(6.0, 2.0), weather=Weather(ambient=1.0, shadows=s)) for s in (False, True))
    np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("distance_m", [5.0, 20.0, 60.0])
def test_haze_takes_contrast_exponentially(distance_m: float) -> None:
    dark = dataclasses.replace(wall(distance_m, side_m=400.0), surface=Surface(albedo=0.1, texture=0.0))
    near = dataclasses.replace(wall(0.5), surface=Surface(albedo=0.1, texture=0.0))
    hazy = Weather(haze_m=30.0)
    without = gray_of(near, weather=Weather(haze_m=1e6)).mean()
    sky = 255 * hazy.sky
    clear = np.exp(-distance_m / 30.0)
    assert gray_of(dark, weather=hazy).mean() == pytest.approx(clear * without + (1 - clear) * sky, abs=1.5)


def test_a_surface_without_texture_is_uniform_and_its_strength_scales_contrast() -> None:
    def contrast(texture: float) -> float:
        body = dataclasses.replace(wall(3.0), surface=Surface(albedo=0.4, texture=texture))
        return float(gray_of(body, weather=Weather(haze_m=1e6)).std())

    assert contrast(0.0) == 0
    assert contrast(0.6) == pytest.approx(2 * contrast(0.3), rel=0.05)


def test_texture_finer_than_a_pixel_is_filtered_out() -> None:
    def roughness(distance_m: float) -> float:
        gray = gray_of(wall(distance_m, side_m=400.0), weather=Weather(haze_m=1e6))
        return float(np.abs(np.diff(gray, axis=1)).mean() / gray.std())

    assert roughness(40.0) < 3 * roughness(4.0), "a far wall is no static"


@pytest.mark.parametrize("pattern", get_args(Pattern))
def test_textures_move_with_their_body_and_vary_about_its_albedo(pattern: Pattern) -> None:
    grays = []
    for moved_m in (0.0, 3.7):
        body = Body(
            name="wall",
            shape=Box((1.0, 60.0, 60.0)),
            position_m=(10.5, moved_m, 0.0),
            surface=Surface(albedo=0.4, pattern=pattern),
        )
        with World(Scene(seed=1, bodies=(body,), weather=Weather(haze_m=1e6)), np.empty((0, 3))) as world:
            (image,) = create_renderer("raster", world).render([camera_at(0, moved_m, 0)])
            grays.append(image.gray.astype(int))
    assert np.quantile(np.abs(grays[0] - grays[1]), 0.999) <= 1
    assert grays[0].std() > 2
    plain = gray_of(dataclasses.replace(body, surface=Surface(albedo=0.4, texture=0.0)), weather=Weather(haze_m=1e6))
    assert grays[0].mean() == pytest.approx(plain.mean(), rel=0.25)


def test_facades_have_dark_windows_of_their_size() -> None:
    """Panes are 0.56 of 1.7 m wide and a half of 3.2 m high, and two thirds of them are much darker than the wall."""
    facade = dataclasses.replace(wall(8.0), surface=Surface(albedo=0.4, pattern="facade"))
    gray = gray_of(facade, weather=Weather(haze_m=1e6))
    assert 0.15 < (gray < 0.7 * np.median(gray)).mean() < 0.3


def test_the_sky_is_brightest_at_the_horizon_and_clouds_are_far_away() -> None:
    behind = wall(-30.0)
    clear = gray_of(behind, weather=Weather(clouds=0.0))
    np.testing.assert_allclose(clear[60], 255 * 0.85, atol=1.5)
    assert (np.diff(clear[:60].mean(axis=1)) >= 0).all()
    with World(Scene(seed=1, bodies=(behind,)), np.empty((0, 3))) as world:
        here, there = create_renderer("raster", world).render([camera_at(0, 0, 0), camera_at(9, 5, 2)])
    np.testing.assert_array_equal(here.gray, there.gray)
    assert (here.gray - clear)[:40].std() > 2


def test_drones_are_drawn_where_they_are_now() -> None:
    with world_of(wall(8.0), starts_m=[(3.0, 0.0, 0.0), (4.0, 1.5, 0.0)]) as world:
        renderer = create_renderer("raycast", world)
        world.apply([VelocityCommand(velocity_m_s=np.array([0.0, 0.5, 0.2]), yaw_rad=0.0)] * 2)
        for _ in range(240):
            world.step()
        (image,) = renderer.render([camera_at(0, 0, 0)])
        positions = [state.position_m for state in world.states]
    for drone, at in zip(world.drone_ids, positions, strict=True):
        rows, cols = np.nonzero(image.segment_id == drone)
        expected = CAMERA.cx_px - CAMERA.fx_px * at[1] / at[0], CAMERA.cy_px - CAMERA.fy_px * at[2] / at[0]
        np.testing.assert_allclose((cols.mean(), rows.mean()), expected, atol=1.0)
    assert set(np.unique(image.segment_id)) == {0, *world.drone_ids}
