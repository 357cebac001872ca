"""The rasteriser shows the nearest triangle of each pixel, of whatever shape; `test_renderers` has whole scenes."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim.bodies import Body, Heightfield, Mesh
from sim.render.meshes import SceneMeshes, box, cylinder, heightfield, merged, moved, sphere
from sim.render.raster import MIN_VOLUME_M3, Rasteriser
from sim.render.raycast import Hits
from sim.types import Camera
from tests.helpers import world_of
from voxdepth.types import Intrinsics

CAMERA = Intrinsics(width_px=13, height_px=9, fx_px=8.0, fy_px=9.0, cx_px=6.3, cy_px=3.9)
ROW, COL = np.indices(CAMERA.shape)
RAYS = np.stack(
    [(COL - CAMERA.cx_px) / CAMERA.fx_px, (ROW - CAMERA.cy_px) / CAMERA.fy_px, np.ones(CAMERA.shape)], axis=-1
)
SOLIDS = {
    "box": box(np.array([1.0, 2.0, 0.5])),
    "cylinder": cylinder(radius_m=0.7, height_m=1.5),
    "sphere": sphere(0.8),
}
A, B, C = [0.3, 0.2, 2.0], [1.5, -0.4, 3.0], [-0.7, 1.1, 2.5]
DEGENERATE = {
    "no area": [A, B, (np.array(A) + B) / 2],
    "a point": [A, A, A],
    "edge-on": [[0, 0, 1], [0, 0, 4], [0, 1, 3]],
    "behind": [[0.3, 0.2, -2.0], [1.5, -0.4, -3.0], [-0.7, 1.1, -2.5]],
    "across the image plane": [[0.3, 0.2, -2.0], B, C],
    "a corner in the camera": [[0, 0, 0], B, C],
    "the camera within it": [[-5, -5, 0], [5, -5, 0], [0, 5, 0]],
    "beside the image": [[30, 0, 1], [31, 0, 1], [30, 1, 1]],
    "larger than the image": [[-1e3, -1e3, 4], [1e3, -1e3, 4], [0, 1e3, 4]],
    "far away": [[-1e6, -1e6, 1e7], [1e6, -1e6, 1e7], [0, 1e6, 1e7]],
}


def rasterised(*bodies: Mesh) -> Hits:
    """What a camera at the origin of the world sees whose axes are those of the world."""
    with world_of(*(Body(name=f"body-{k}", shape=mesh) for k, mesh in enumerate(bodies))) as world:
        return Rasteriser(SceneMeshes(world), 1).first_hits([Camera(T_world_cam=np.eye(4), intrinsics=CAMERA)])[0]


def edge_functions(corners_m: np.ndarray) -> np.ndarray:
    """The three edge functions of a triangle at each pixel, shape (H, W, 3); none is positive without a volume."""
    a, b, c = corners_m
    volume_m3 = a @ np.cross(b, c)
    if abs(volume_m3) <= MIN_VOLUME_M3:
        return np.full((*CAMERA.shape, 3), -1.0)
    return np.asarray(RAYS @ np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1) / volume_m3)


def require_nearest(*bodies: Mesh) -> None:
    hits, scene = rasterised(*bodies), merged(bodies)
    edges = np.array([edge_functions(scene.vertices_m[t]) for t in scene.triangles])
    scale = np.maximum(np.abs(edges).max(axis=(1, 2, 3), keepdims=True), 1e-30)
    clear = ~(np.abs(edges) < 1e-5 * scale).any(axis=(0, 3))
    inverse = np.where((edges >= 0).all(axis=3), edges.sum(axis=3), 0)
    expected = inverse.max(axis=0)
    np.testing.assert_allclose(1 / hits.depth_m[clear], expected[clear], rtol=1e-6, atol=1e-12)
    seen = clear & (expected > 0)
    own = np.take_along_axis(inverse, np.where(seen, hits.triangle, 0)[None], axis=0)[0]
    np.testing.assert_allclose(own[seen], expected[seen], rtol=1e-6)
    assert (hits.triangle[clear & ~seen] == len(scene.triangles)).all()


@settings(max_examples=15)
@given(st.integers(0, 2**31))
def test_random_triangles(seed: int) -> None:
    rng = np.random.default_rng(seed)
    middle_m, size_m = rng.uniform((-1, -1, -1), (1, 1, 5), (3, 3)), rng.uniform(0.1, 4, 3)
    require_nearest(
        *(Mesh(m + s * rng.normal(size=(6, 3)), rng.integers(0, 6, (5, 3)).astype(np.uint32))
          for m, s in zip(middle_m, size_m, strict=True))
    )  # fmt: skip


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_degenerate_triangles(name: str, order: tuple[int, int, int]) -> None:
    triangle = Mesh(np.array(DEGENERATE[name], np.float64), np.array([order], np.uint32))
    require_nearest(triangle, moved(SOLIDS["box"], np.eye(3), np.array([0, 0, 5.0])))


@settings(max_examples=12)
@given(st.sampled_from(sorted(SOLIDS)), st.integers(0, 2**31))
def test_faces_that_are_turned_away_change_nothing(solid: str, seed: int) -> None:
    """A triangle that is missing behind the camera leaves the surface open, so that all faces are drawn."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    body = moved(SOLIDS[solid], q * np.linalg.det(q), rng.uniform((-1, -1, -1), (1, 1, 5)))
    far = Mesh(np.array([[0, 0, -1e3], [1, 0, -1e3], [0, 1, -1e3]]), np.array([[0, 1, 2]], np.uint32))
    closed, opened = rasterised(body), rasterised(merged([body, far]))
    np.testing.assert_array_equal(closed.depth_m, opened.depth_m)


def test_only_closed_surfaces_hide_the_faces_that_are_turned_away() -> None:
    for mesh in SOLIDS.values():
        turned = Mesh(mesh.vertices_m, np.ascontiguousarray(mesh.triangles[:, ::-1]))
        assert mesh.is_closed
        assert merged([mesh, moved(mesh, np.eye(3), np.array([5.0, 0, 0]))]).is_closed
        for opened in (turned, Mesh(mesh.vertices_m, mesh.triangles[:-1]), merged([mesh, turned])):
            assert not opened.is_closed
    assert not heightfield(Heightfield(np.random.default_rng(0).uniform(size=(4, 5)), 0.5)).is_closed
