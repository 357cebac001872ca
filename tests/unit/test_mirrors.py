"""A pane shows what it reflects, and a stereo camera measures that."""

from dataclasses import replace

import numpy as np
import pytest

from sim.bodies import Body, Box, Scene, Surface
from sim.render import create_renderer
from sim.render.mirrors import FRAME_M
from sim.sensor import RigConfig
from sim.types import Camera, CameraImages
from sim.world import World
from tests.helpers import block, camera_at, captured, wall, world_of

PANE_M = 3.0


def pane(reflectivity: float, *, yaw_rad: float = 0.0, side_m: float = 2.0) -> Body:
    """A pane without texture of its own, whose front is at x = 3."""
    surface = Surface(albedo=0.5, texture=0.0, reflectivity=reflectivity)
    shape = Box((0.2, side_m, side_m))
    return Body(name="pane", shape=shape, position_m=(PANE_M + 0.1, 0.0, 0.0), yaw_rad=yaw_rad, surface=surface)


def seen(*bodies: Body, at: Camera | None = None) -> CameraImages:
    with world_of(*bodies) as world:
        return create_renderer("raster", world).render([at or camera_at(0, 0, 0)])[0]


@pytest.mark.parametrize(("behind_m", "reflectivity"), [(1.0, 1.0), (4.0, 0.6)])
def test_a_stereo_camera_measures_the_mirror_image(behind_m: float, reflectivity: float) -> None:
    config = RigConfig(width_px=640, height_px=360, mount_forward_m=0.0)
    bodies = pane(reflectivity), wall(-behind_m - 1.0), wall(9.0, name="far")
    capture = captured(config, *bodies, renderer="raster")
    on_pane = np.abs(capture.depth_true_m - PANE_M) < 1e-3
    inner = np.zeros_like(on_pane)
    inner[120:240, 260:380] = True
    assert on_pane[inner].all()
    measured_m = capture.depth_raw_m[inner]
    assert (measured_m > 0).mean() > 0.9
    error_px = config.intrinsics.focal_baseline_px_m * (1 / measured_m[measured_m > 0] - 1 / (2 * PANE_M + behind_m))
    assert abs(np.median(error_px)) < 0.3


def test_a_pane_shows_as_much_of_the_reflection_as_it_reflects_at_its_own_depth() -> None:
    images = {r: seen(pane(r), wall(-3.0)) for r in (0.0, 0.5, 1.0)}
    gray = {r: image.gray.astype(float) for r, image in images.items()}
    on_pane = images[0.0].segment_id == 0
    np.testing.assert_array_equal(images[0.0].segment_id, images[1.0].segment_id)
    np.testing.assert_array_equal(images[0.0].depth_m, images[1.0].depth_m)
    assert gray[1.0][on_pane].std() > 10
    assert gray[0.0][on_pane].std() < 1
    np.testing.assert_allclose(gray[0.5][on_pane], (gray[0.0] + gray[1.0])[on_pane] / 2, atol=1)
    np.testing.assert_array_equal(gray[0.0][~on_pane], gray[1.0][~on_pane])


def test_frames_between_panes_reflect_nothing() -> None:
    """Panes of 0.5 m: the frames are where the plain body shows, and are a seventh to a quarter of the surface."""
    plain, shown = pane(0.0), wall(-3.0)
    framed = replace(pane(1.0), surface=replace(pane(1.0).surface, pane_m=0.5))
    gray, bare, reflected = (seen(body, shown).gray for body in (framed, plain, pane(1.0)))
    on_pane = seen(plain).segment_id == 0
    is_frame = on_pane & (gray != reflected)
    np.testing.assert_array_equal(gray[is_frame], bare[is_frame])
    share = 1 - (1 - FRAME_M / 0.5) ** 2
    assert 0.6 * share < is_frame[on_pane].mean() < 1.3 * share


def test_level_glass_has_no_frames() -> None:
    lying = replace(pane(1.0), shape=Box((9.0, 4.0, 0.2)), position_m=(PANE_M, 0.0, -0.6))
    framed = replace(lying, surface=replace(lying.surface, pane_m=0.5))
    np.testing.assert_array_equal(seen(framed, wall(6.0)).gray, seen(lying, wall(6.0)).gray)


@pytest.mark.parametrize("side_m", [-1.5, 1.5])
def test_a_turned_pane_shows_what_is_beside_it(side_m: float) -> None:
    """At 45 degrees a pane shows a white body on one side, and not one on the other or behind the pane."""
    white = Surface(albedo=1.0, texture=0.0)
    shown = Body(name="shown", shape=Box((1.0, 1.0, 1.0)), position_m=(PANE_M, 2 * side_m, 0.0), surface=white)
    yaw_rad = -np.sign(side_m) * np.pi / 4
    turned = pane(1.0, yaw_rad=yaw_rad, side_m=1.0)
    other = Body(name="other", shape=Box((1.0, 1.0, 1.0)), position_m=(PANE_M, -2 * side_m, 0.0), surface=white)
    middle = np.s_[55:65, 75:85]
    plain = seen(turned).gray[middle]
    assert (seen(turned, shown).gray[middle] != plain).all()
    np.testing.assert_array_equal(seen(turned, other).gray[middle], plain)


def test_drones_see_themselves_in_a_pane() -> None:
    grays = []
    for starts in ([], [[0.0, 0.0, 0.0]]):
        with World(Scene(seed=1, bodies=(pane(1.0),)), np.array(starts).reshape(-1, 3)) as world:
            grays.append(create_renderer("raster", world).render([camera_at(0.3, 0, 0)])[0].gray)
    assert (grays[0] != grays[1]).any()


def test_panes_reflect_nothing_of_what_is_behind_them() -> None:
    np.testing.assert_array_equal(seen(pane(1.0)).gray, seen(pane(1.0), block(5.0, 0.5)).gray)


def test_a_camera_inside_of_a_reflecting_body_is_no_error() -> None:
    assert (seen(pane(1.0), at=camera_at(PANE_M + 0.1, 0, 0)).gray >= 0).all()


def test_other_renderers_draw_no_reflection() -> None:
    with world_of(pane(1.0), wall(-3.0)) as world:
        gray = create_renderer("raycast", world).render([camera_at(0, 0, 0)])[0].gray
    on_pane = seen(pane(0.0)).segment_id == 0
    assert gray[on_pane].std() < 1
