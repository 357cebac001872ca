"""The loops of rasterisation give the numbers of their NumPy twins."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim.bodies import Heightfield, Mesh
from sim.render import raster_kernels as kernels
from sim.render.meshes import bounding_sphere, box, cylinder, heightfield, is_closed, merged, moved, normals, sphere
from sim.render.raster import view_of
from sim.types import Camera
from voxdepth.compiled import compile_all
from voxdepth.types import Intrinsics

SEEDS = st.integers(0, 2**31)
CAMERA = Intrinsics(width_px=13, height_px=9, fx_px=8.0, fy_px=9.0, cx_px=6.3, cy_px=3.9)
PINHOLE_PX = np.array([CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px])
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
    "edges through pixels": [[-2.3, -1.9, 4], [1.7, -1.9, 4], [-2.3, 2.1, 4]],
}


@pytest.fixture(autouse=True, scope="module")
def _compiled() -> None:
    compile_all()


def pose_of(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return np.ascontiguousarray(q * np.linalg.det(q)), rng.uniform(-1, 1, 3)


def view(rotation: np.ndarray, origin_m: np.ndarray) -> kernels.View:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.linalg.inv(rotation), origin_m
    return view_of(Camera(T_world_cam=pose, intrinsics=CAMERA))


def rasterised(
    bodies: list[Mesh], rotation: np.ndarray, origin_m: np.ndarray, closed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    scene, size = merged(bodies), CAMERA.width_px * CAMERA.height_px
    n, normal = len(scene.triangles), normals(scene)
    all_bodies = kernels.Bodies(
        vertices_m=scene.vertices_m,
        triangles=scene.triangles,
        faces=np.column_stack([normal, -(normal * scene.vertices_m[scene.triangles[:, 0]]).sum(axis=1)]),
        first_vertex=np.cumsum([0, *(len(mesh.vertices_m) for mesh in bodies)], dtype=np.int32),
        first_triangle=np.cumsum([0, *(len(mesh.triangles) for mesh in bodies)], dtype=np.int32),
        spheres_m=np.array([bounding_sphere(mesh) for mesh in bodies]),
        is_closed=np.full(len(bodies), closed),
    )
    buffers = kernels.Buffers(
        np.empty((len(scene.vertices_m), 5)), np.empty(n, np.int32), np.empty((n, 9)), np.empty((n, 3), np.int32)
    )
    nearest, inverse_depth = np.full(size, n, np.int32), np.zeros(size)
    order = np.arange(len(bodies), dtype=np.int32)
    kernels.rasterise(view(rotation, origin_m), all_bodies, order, buffers, inverse_depth, nearest)
    return nearest, inverse_depth


def edge_functions(corners_m: np.ndarray, rotation: np.ndarray, origin_m: np.ndarray) -> np.ndarray:
    """The three edge functions of a triangle at each pixel, shape (H * W, 3); none is positive without a volume."""
    a, b, c = (corners_m - origin_m) @ rotation.T
    volume_m3 = a @ np.cross(b, c)
    row, col = np.divmod(np.arange(CAMERA.width_px * CAMERA.height_px), CAMERA.width_px)
    fx, fy, cx, cy = PINHOLE_PX
    rays = np.stack([(col - cx) / fx, (row - cy) / fy, np.ones(len(row))], axis=1)
    if abs(volume_m3) <= kernels.MIN_VOLUME_M3:
        return np.full((len(rays), 3), -1.0)
    return np.asarray(rays @ np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1) / volume_m3)


def check_against_twin(bodies: list[Mesh], rotation: np.ndarray, origin_m: np.ndarray) -> None:
    nearest, inverse_depth = rasterised(bodies, rotation, origin_m)
    scene = merged(bodies)
    edges = np.array([edge_functions(scene.vertices_m[t], rotation, origin_m) for t in scene.triangles])
    scale = np.maximum(np.abs(edges).max(axis=(1, 2), keepdims=True), 1e-30)
    inverse = np.where((edges >= 0).all(axis=2), edges.sum(axis=2), 0)
    on_edge = (np.abs(edges) < 1e-5 * scale).any(axis=2).any(axis=0)
    expected = inverse.max(axis=0)
    np.testing.assert_allclose(inverse_depth[~on_edge], expected[~on_edge], rtol=1e-6, atol=1e-12)
    seen = ~on_edge & (expected > 0)
    own = inverse[nearest[seen], np.flatnonzero(seen)]
    np.testing.assert_allclose(own, expected[seen], rtol=1e-6)
    assert (nearest[~on_edge & (expected == 0)] == len(scene.triangles)).all()


@given(SEEDS, st.integers(1, 8))
def test_random_triangles(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    rotation, origin_m = pose_of(rng)
    ahead = np.linalg.inv(rotation) @ [0, 0, 3]
    bodies = [
        Mesh(ahead + rng.normal(size=(6, 3)) * rng.uniform(0.1, 4), rng.integers(0, 6, (5, 3)).astype(np.uint32))
        for _ in range(n)
    ]
    check_against_twin(bodies, rotation, origin_m)


@pytest.mark.parametrize("name", DEGENERATE)
@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0)])
def test_degenerate_triangles(name: str, order: tuple[int, int, int]) -> None:
    corners_m = np.array(DEGENERATE[name], np.float64)
    bodies = [Mesh(corners_m, np.array([order], np.uint32)), moved(SOLIDS["sphere"], np.eye(3), np.array([0, 0, 5.0]))]
    check_against_twin(bodies, np.eye(3), np.zeros(3))


def test_edges_through_pixels_belong_to_the_triangle() -> None:
    corners_m = np.array(DEGENERATE["edges through pixels"], np.float64)
    even = Mesh(np.concatenate([corners_m, [[1.7, 2.1, 4]]]), np.array([[0, 1, 2], [3, 2, 1]], np.uint32))
    nearest, inverse_depth = rasterised([even], np.eye(3), np.zeros(3))
    assert (nearest < 2).sum() >= 8 * 9, "from column 1.7 to 9.7, and from row -0.4 to 8.6"
    np.testing.assert_allclose(inverse_depth[nearest < 2], 0.25)


@given(SEEDS, st.floats(-1, 9))
def test_only_what_is_behind_all_pixels_of_a_box_is_hidden(seed: int, least_depth_m: float) -> None:
    rng = np.random.default_rng(seed)
    height, width = CAMERA.shape
    inverse_depth = np.where(rng.random((height, width)) < 0.9, 1 / rng.uniform(1, 9, (height, width)), 0)
    top, left = rng.integers(0, height), rng.integers(0, width)
    bottom, right = top + rng.integers(-1, 3), left + rng.integers(-1, 3)
    box = tuple(int(edge) for edge in (top, min(bottom, height - 1), left, min(right, width - 1)))
    seen = inverse_depth[top : bottom + 1, left : right + 1]
    is_hidden = kernels.is_hidden(box, least_depth_m, width, inverse_depth.reshape(-1))
    nearer = seen > 1 / least_depth_m if least_depth_m > kernels.NEAR_M else np.zeros(seen.shape)
    assert is_hidden == nearer.all()


@pytest.mark.parametrize("solid", SOLIDS)
@given(SEEDS)
def test_faces_that_are_turned_away_change_nothing(solid: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation, origin_m = pose_of(rng)
    turn, _ = pose_of(rng)
    ahead_m = rng.uniform((-1, -1, -1), (1, 1, 5))
    place_m = origin_m + np.linalg.inv(rotation) @ ahead_m
    body = moved(SOLIDS[solid], turn, place_m)
    all_faces, near_faces = (rasterised([body], rotation, origin_m, closed) for closed in (False, True))
    np.testing.assert_array_equal(near_faces[0], all_faces[0])
    np.testing.assert_array_equal(near_faces[1], all_faces[1])


def test_only_closed_surfaces_hide_the_faces_that_are_turned_away() -> None:
    hills = heightfield(Heightfield(np.random.default_rng(0).uniform(size=(4, 5)), 0.5))
    for mesh in SOLIDS.values():
        turned = Mesh(mesh.vertices_m, np.ascontiguousarray(mesh.triangles[:, ::-1]))
        assert is_closed(mesh)
        assert is_closed(merged([mesh, moved(mesh, np.eye(3), np.array([5.0, 0, 0]))]))
        assert not is_closed(turned)
        assert not is_closed(Mesh(mesh.vertices_m, mesh.triangles[:-1]))
        assert not is_closed(merged([mesh, turned]))
    assert not is_closed(hills)


@given(SEEDS)
def test_spheres_in_the_image_are_not_left_out(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rotation, origin_m = pose_of(rng)
    sphere_m = np.append(origin_m + rng.uniform(-6, 6, 3), rng.uniform(0.01, 3))
    points = rng.normal(size=(200, 3))
    points *= sphere_m[3] / np.linalg.norm(points, axis=1, keepdims=True)
    x, y, z = rotation @ (points + sphere_m[:3] - origin_m).T
    col, row = PINHOLE_PX[:2, None] * np.array([x, y]) / z + PINHOLE_PX[2:, None]
    seen = (z > 0) & (col >= 0) & (col <= CAMERA.width_px - 1) & (row >= 0) & (row <= CAMERA.height_px - 1)
    may_see, inside = kernels.sight_of(view(rotation, origin_m), sphere_m)
    assert may_see or not seen.any()
    assert inside == (np.linalg.norm(sphere_m[:3] - origin_m) <= sphere_m[3])


def test_depth_without_a_surface_is_infinite() -> None:
    depth_m = np.empty(3, np.float32)
    kernels.invert(np.array([0.0, 0.25, 1e3]), depth_m)
    np.testing.assert_array_equal(depth_m, np.array([np.inf, 4, 1e-3], np.float32))
