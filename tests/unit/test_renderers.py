"""The renderers are independent of each other and must agree."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.bodies import Body, Cylinder, Sphere
from sim.errors import RenderError
from sim.render import create_renderer
from sim.render.meshes import mesh_of_body
from sim.scenes import CitySpec
from sim.types import Images
from sim.world import World
from tests.helpers import camera_at, wall, world_of
from voxdepth.types import Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=200, height_px=120, hfov_deg=86)


def agreement(a: Images, b: Images) -> float:
    """Share of pixels away from edges whose depths differ by at most 1 cm."""
    edges = np.zeros(a.segment_id.shape, np.uint8)
    for image in (a, b):
        ids = (image.segment_id + 1).astype(np.float32)
        edges |= (cv2.dilate(ids, np.ones((3, 3))) != cv2.erode(ids, np.ones((3, 3)))).astype(np.uint8)
    away = edges == 0
    both = np.isfinite(a.depth_m) & np.isfinite(b.depth_m)
    nothing = np.isinf(a.depth_m) & np.isinf(b.depth_m)
    gap = np.zeros(a.depth_m.shape, np.float32)
    gap[both] = np.abs(a.depth_m[both] - b.depth_m[both])
    # Beyond 60 m a pixel of slanted ground is metres deep: 1 cm of depth is then a millionth of the pixel's footprint.
    judged = away & (nothing | both) & (np.where(both, a.depth_m, 0) < 60)
    assert (np.isfinite(a.depth_m) == np.isfinite(b.depth_m))[away].mean() > 0.995
    return float((gap[judged] <= 0.01).mean())


@settings(max_examples=12)
@given(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(-3.1, 3.1), st.floats(-6, 30), st.integers(0, 3))
def test_they_agree_in_the_city_rolled_and_pitched(roll: float, pitch: float, yaw: float, x: float, seed: int) -> None:
    q = quaternion(roll, pitch, yaw)
    with World(CitySpec().build(seed), np.array([[-3.0, 0, 6], [-5, 1, 6]])) as world:
        if world.room_at_m((x, 0.0, 5.0)) < 0.1:
            return
        a, b = (create_renderer(name, world).render([camera_at(x, 0, 5, q, CAMERA)])[0] for name in ("raycast", "tiny"))
    assert agreement(a, b) > 0.995


def test_they_agree_on_moved_drones_and_round_shapes() -> None:
    shapes = [
        Body(name="pole", kind="building", shape=Cylinder(0.3, 4.0), position_m=(3.0, 1.0, 0.0)),
        Body(name="ball", kind="building", shape=Sphere(0.6), position_m=(4.0, -1.0, 0.5)),
    ]
    with world_of(*shapes, wall(8.0), starts_m=[(2.5, 0.0, 0.0)]) as world:
        for _ in range(120):
            world.step()
        a, b = (create_renderer(name, world).render([camera_at(0, 0, 0)])[0] for name in ("raycast", "tiny"))
    assert len(np.unique(a.segment_id)) == 4
    assert (a.segment_id == b.segment_id).mean() > 0.99
    same = a.segment_id == b.segment_id
    gap = np.abs(a.depth_m - b.depth_m)[same]
    # The two draw round shapes with other facets: up to 5 cm apart on grazed rims, nothing elsewhere.
    assert np.percentile(gap, 95) < 0.01
    assert np.percentile(gap, 99) < 0.05


def test_textures_are_the_same_from_both_sides_of_a_baseline() -> None:
    with world_of(wall(5.0)) as world:
        left, right = create_renderer("raycast", world).render(
            [camera_at(0, 0.5, 0, intrinsics=CAMERA), camera_at(0, 0, 0, intrinsics=CAMERA)]
        )
    shift = CAMERA.fx_px * 0.5 / 5.0
    moved = cv2.warpAffine(right.gray, np.array([[1, 0, shift], [0, 1, 0]]), (200, 120))[:, 20:]
    assert np.abs(moved.astype(int) - left.gray[:, 20:]).mean() < 2.5
    assert left.gray.std() > 10


def test_without_gray_the_depth_is_the_same() -> None:
    with world_of(wall(5.0)) as world:
        renderer = create_renderer("raycast", world)
        lit, dark = renderer.render([camera_at(0, 0, 0)])[0], renderer.render([camera_at(0, 0, 0)], gray=False)[0]
    np.testing.assert_array_equal(lit.depth_m, dark.depth_m)
    np.testing.assert_array_equal(lit.segment_id, dark.segment_id)
    assert not dark.gray.any()


def test_bodies_that_cannot_be_drawn_are_named() -> None:
    import pybullet

    with world_of(wall(5.0)) as world:
        body = pybullet.createMultiBody(0, -1, -1, [0, 0, 0], [0, 0, 0, 1], physicsClientId=world.client)
        with pytest.raises(RenderError, match=f"body {body} has no visual shape"):
            mesh_of_body(world, body)


def test_unknown_renderers_are_refused_with_the_choice() -> None:
    with world_of(wall(5.0)) as world, pytest.raises(RenderError, match="raycast, tiny"):
        create_renderer("pathtracer", world)


def quaternion(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Of body angles, in the order xyzw."""
    cr, sr, cp, sp, cy, sy = (f(a / 2) for a in (roll, pitch, yaw) for f in (np.cos, np.sin))
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
