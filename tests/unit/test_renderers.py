"""The renderers are independent of each other and must agree."""

import os
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

import cv2
import numpy as np
import pytest

from sim import frames
from sim.bodies import Body, Cylinder, Heightfield, Mesh, Mover, Scene, SceneSpec, Sphere
from sim.errors import RenderError
from sim.render import create_renderer
from sim.render.meshes import box, sphere
from sim.scenes import CitySpec, CorridorSpec, ForestSpec, GapSpec, LawnSpec, PlainsSpec
from sim.types import Camera, CameraImages
from sim.world import World
from tests.helpers import camera_at, wall, world_of
from voxdepth.types import Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=200, height_px=120, hfov_deg=86)
SCENES = (
    CitySpec(),
    CorridorSpec(),
    ForestSpec(length_m=70, width_m=24, bushes=20),
    GapSpec(),
    LawnSpec(length_m=70),
    PlainsSpec(length_m=150, width_m=70),
)


def agreement(a: CameraImages, b: CameraImages, *, world: World | None = None) -> float:
    """Share of pixels away from edges and within 60 m whose depths differ by at most 1 cm.

    TinyRenderer draws cylinders with some eight facets, so those of the world may differ by a tenth of their radius
    more.
    """
    # Beyond 60 m a pixel of slanted ground is metres deep: 1 cm of depth is then a millionth of the pixel's footprint.
    edges = np.zeros(a.segment_id.shape, np.uint8)
    for image in (a, b):
        ids = (image.segment_id + 1).astype(np.float32)
        edges |= (cv2.dilate(ids, np.ones((3, 3))) != cv2.erode(ids, np.ones((3, 3)))).astype(np.uint8)
        folds = np.minimum(image.depth_m, 1e3).astype(np.float32)
        bend = np.abs(cv2.Laplacian(1 / folds, cv2.CV_32F))
        edges |= cv2.dilate((bend > 2e-3).astype(np.uint8), np.ones((3, 3)))  # creases and rims within one body
    away = edges == 0
    both = np.isfinite(a.depth_m) & np.isfinite(b.depth_m)
    nothing = np.isinf(a.depth_m) & np.isinf(b.depth_m)
    gap = np.zeros(a.depth_m.shape, np.float32)
    gap[both] = np.abs(a.depth_m[both] - b.depth_m[both])
    compared = away & (nothing | both) & (np.where(both, a.depth_m, 0) < 60)
    assert compared.mean() > 0.2, "most of the picture is left out: choose another view"
    assert (np.isfinite(a.depth_m) == np.isfinite(b.depth_m))[away].mean() > 0.995
    tolerance_m = np.full(gap.shape, 0.01)
    for body_id, body in (world.bodies if world else {}).items():
        if isinstance(body.shape, Cylinder):
            tolerance_m[a.segment_id == body_id] += 0.1 * body.shape.radius_m
    return float((gap <= tolerance_m)[compared].mean())


@contextmanager
def views_of(spec: SceneSpec, nearest_m: float) -> Iterator[tuple[World, list[Camera]]]:
    """A scene with a drone, and random views of it, rolled and pitched, some of them close to walls."""
    scene, rng = spec.build(3), np.random.default_rng(0)
    with World(scene, scene.path_m[len(scene.path_m) // 2][None] + [0.0, 0.0, 2.5]) as world:
        path_m = scene.path_m[rng.integers(len(scene.path_m), size=16)]
        positions_m = path_m + rng.uniform((0, -6, 0.1), (0, 6, 6), (16, 3))
        angles = rng.uniform((-0.5, -0.4, -3.1), (0.5, 0.4, 3.1), (16, 3))
        cameras = [
            camera_at(*at_m, frames.quaternion_from_angles(yaw, -pitch, roll), CAMERA)
            for at_m, (roll, pitch, yaw) in zip(positions_m, angles, strict=True)
            if world.clearance_at_m(at_m.tolist()) > nearest_m and not world.is_inside(at_m)
        ]
        assert len(cameras) >= 5, "hardly any view is outside of bodies"
        yield world, cameras


@pytest.mark.slow
@pytest.mark.parametrize("spec", SCENES, ids=lambda spec: spec.kind)
def test_ray_casting_and_what_pybullet_draws_agree_in_every_scene(spec: SceneSpec) -> None:
    # TinyRenderer may hang when it looks along an axis to the last bit, which no random view does.
    with views_of(spec, nearest_m=0.12) as (world, cameras):
        cast, drawn = (create_renderer(name, world).render(cameras) for name in ("raycast", "tiny"))
        assert min(agreement(a, b, world=world) for a, b in zip(cast, drawn, strict=True)) > 0.995


@pytest.mark.parametrize("spec", SCENES, ids=lambda spec: spec.kind)
def test_rasterising_and_ray_casting_show_the_same(spec: SceneSpec) -> None:
    with views_of(spec, nearest_m=0.05) as (world, cameras):
        drawn, cast = (create_renderer(name, world).render(cameras) for name in ("raster", "raycast"))
    for a, b in zip(drawn, cast, strict=True):
        same = a.segment_id == b.segment_id
        assert same.mean() > 0.9995
        np.testing.assert_allclose(a.depth_m[same], b.depth_m[same], rtol=1e-3)
        assert np.quantile(np.abs(a.gray[same].astype(int) - b.gray[same]), 0.999) <= 1


def test_nothing_shines_through_where_triangles_meet() -> None:
    """Seen straight on, edges and diagonals of these walls run exactly through the centres of pixels."""
    even = Intrinsics(width_px=81, height_px=81, fx_px=40.0, fy_px=40.0, cx_px=40.0, cy_px=40.0)
    shape = box(np.array([1.0, 2.0, 2.0]))
    tiles = [
        Body(name=f"tile {y} {z}", kind="building", shape=shape, position_m=(4.5, float(y), float(z)))
        for y in range(-6, 7, 2)
        for z in range(-6, 7, 2)
    ]
    with world_of(*tiles) as world:
        (image,) = create_renderer("raster", world).render([camera_at(0, 0, 0, intrinsics=even)])
    np.testing.assert_allclose(image.depth_m, 4.0, rtol=1e-6)


def test_threads_change_nothing_whether_they_share_a_batch_or_draw_different_worlds() -> None:
    def drawn(distance_m: float, threads: int = 1) -> list[CameraImages]:
        with world_of(wall(distance_m), starts_m=[(2.5, 0.3, 0.0)]) as world:
            cameras = [camera_at(0, 0.02 * i, 0) for i in range(30)]
            return create_renderer("raster", world, threads=threads).render(cameras)

    distances_m = [4.0, 5.0, 6.0]
    with ThreadPoolExecutor(3) as pool:
        together = [*pool.map(drawn, distances_m), drawn(4.0, 3)]
    for images, distance_m in zip(together, [*distances_m, 4.0], strict=True):
        for a, b in zip(images, drawn(distance_m), strict=True):
            np.testing.assert_array_equal(a.gray, b.gray)
            np.testing.assert_array_equal(a.depth_m, b.depth_m)
            np.testing.assert_array_equal(a.segment_id, b.segment_id)


def test_they_agree_on_movers() -> None:
    ball = Body(name="ball", kind="mover", shape=Sphere(0.4))
    cube = Mesh(box(np.array([0.5, 0.7, 0.9])).vertices_m, box(np.ones(3)).triangles)
    crate = Body(name="crate", kind="building", shape=cube, position_m=(0.0, 0.0, 0.0), yaw_rad=0.4)
    pole = Body(name="pole", kind="building", shape=Cylinder(0.3, 4.0))
    movers = (
        Mover(body=pole, position_m=lambda time_s: np.array([6.0, 3.0 - time_s, 0.0])),
        Mover(body=ball, position_m=lambda time_s: np.array([3, 0.8 - 1.4 * time_s, 0])),
        Mover(body=ball, position_m=lambda time_s: np.array([5, -1.5, 0.5])),
        Mover(body=crate, position_m=lambda time_s: np.array([4, 1.5, -1])),
    )
    scene = Scene(seed=5, bodies=(wall(8.0),), movers=movers)
    with World(scene, np.array([[4.0, 0.0, 1.0]])) as world:
        renderers = [create_renderer(name, world) for name in ("raster", "raycast", "tiny")]
        for time_s in (0.0, 1.0):
            world.move_to(time_s)
            *ours, b = (renderer.render([camera_at(0, 0, 0)])[0] for renderer in renderers)
            for a in ours:
                assert set(np.unique(a.segment_id)) == {0, 1, 2, 3, 4, 5}
                assert (a.segment_id == b.segment_id).mean() > 0.99
                gap = np.abs(a.depth_m - b.depth_m)[a.segment_id == b.segment_id]
                assert np.percentile(gap, 95) < 0.01


def agreement_of_meshes(name: str) -> float:
    """How far a renderer agrees with ray casting on turned meshes and on heightfields, see `agreement`."""
    rng = np.random.default_rng(0)
    ball = sphere(0.8)
    lump = Mesh(ball.vertices_m * [1.0, 0.6, 1.4], ball.triangles)
    bodies = [
        Body(name="lump", kind="building", shape=lump, position_m=(4.0, 0.3, 0.2), yaw_rad=0.7),
        Body(name="crate", kind="building", shape=box(np.array([0.8, 1.2, 0.5])), position_m=(3.0, -1.2, -0.3)),
        Body(
            name="hills",
            kind="ground",
            shape=Heightfield(rng.uniform(-0.3, 0.3, (30, 40)), 0.5),
            position_m=(6.0, 1.0, -1.5),
            yaw_rad=0.2,
        ),
    ]
    with world_of(*bodies) as world:
        a, b = (create_renderer(one, world).render([camera_at(0, 0, 0)])[0] for one in ("raycast", name))
    assert set(np.unique(a.segment_id)) == {-1, 0, 1, 2}
    return agreement(a, b)


def test_they_agree_on_turned_meshes_and_heightfields() -> None:
    assert agreement_of_meshes("tiny") > 0.995


@pytest.mark.slow
def test_egl_agrees_where_it_works_and_a_crash_of_its_driver_ends_its_own_process() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as alone:
        try:
            assert alone.submit(agreement_of_meshes, "egl").result(timeout=120) > 0.995
        except RenderError as error:
            pytest.skip(str(error))


def test_without_egl_the_renderer_is_refused_instead_of_ending_the_process() -> None:
    code = (
        "import numpy as np\nfrom sim.bodies import Scene\nfrom sim.render import create_renderer\n"
        "from sim.world import World\ncreate_renderer('egl', World(Scene(seed=0, bodies=()), np.zeros((0, 3))))"
    )
    nowhere = {**os.environ, "__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent", "LD_LIBRARY_PATH": ""}
    nowhere["PYTHONOPTIMIZE"] = "1"  # The check of the plugin is no assertion.
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=nowhere)
    assert done.returncode == 1
    assert "RenderError: the renderer 'egl' does not work here: install" in done.stderr


def test_without_gray_the_depth_is_the_same() -> None:
    with world_of(wall(5.0)) as world:
        renderer = create_renderer("raycast", world)
        lit, dark = renderer.render([camera_at(0, 0, 0)])[0], renderer.render([camera_at(0, 0, 0)], gray=False)[0]
    np.testing.assert_array_equal(lit.depth_m, dark.depth_m)
    np.testing.assert_array_equal(lit.segment_id, dark.segment_id)
    assert not dark.gray.any()


def test_unknown_renderers_are_refused_with_the_choice() -> None:
    with world_of(wall(5.0)) as world, pytest.raises(RenderError, match="raster, raycast, tiny, egl"):
        create_renderer("pathtracer", world)
