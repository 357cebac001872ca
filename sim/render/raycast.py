"""Ray casting with Embree, through Open3D. A visibility backend finds the first surface behind each pixel."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, FloatImage

from ..bodies import Mesh
from ..types import Camera, IdImage
from .meshes import SceneMeshes, merged, open3d

Rays = npt.NDArray[np.float32]
"""Origin and direction in the world frame, shape (..., 6). Directions have z = 1 in their camera's frame, so that the
ray parameter is the depth."""


class Hits(NamedTuple):
    """First hits of rays; the arrays share their leading axes."""

    depth_m: FloatImage
    """Depth [m]; +inf without a hit."""
    normal: FloatImage
    """Surface normal, not normalised, shape (..., 3)."""
    body_index: IdImage
    """Index of the body in `SceneMeshes.body_ids`, or their number without a hit."""


class RayCaster:
    """A visibility backend that casts a ray through every pixel.

    The fixed bodies form one ray casting scene, which is built once. The moving bodies form a second one, which is
    rebuilt for every batch. Only the rays near the bounding spheres of moving bodies are cast into it.
    """

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        self._radii_m = np.array([np.linalg.norm(mesh.vertices_m, axis=1).max() for mesh in meshes.moving])
        n_fixed = sum(len(mesh.triangles) for mesh in meshes.fixed)
        self._fixed = RaycastScene(meshes.fixed, meshes.body_of_triangle[:n_fixed], len(meshes.body_ids), threads)
        self._moving_index = meshes.body_of_triangle[n_fixed:]

    def first_hits(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """The first hit of each ray, shape (cameras, H * W), in the present state of the world."""
        hits = self._fixed.cast(rays)
        if self._meshes.moving:
            self._add_moving(cameras, rays, hits)
        return hits

    def _add_moving(self, cameras: Sequence[Camera], rays: Rays, hits: Hits) -> None:
        """Replace the hits where a moving body is nearer."""
        centers_m = np.array([position_m for _, position_m in self._meshes.moving_poses()])
        bounds = pixel_bounds(cameras, centers_m, self._radii_m)
        if len(bounds) == 0:
            return
        height, width = cameras[0].intrinsics.shape
        pixels = np.concatenate(  # A pixel that two spheres may cover occurs twice.
            [
                (((k * height + np.arange(top, bottom)) * width)[:, None] + np.arange(left, right)).ravel()
                for k, top, bottom, left, right in bounds.tolist()
            ]
        )
        meshes = self._meshes.moving_in_world()
        scene = RaycastScene(meshes, self._moving_index, len(self._meshes.body_ids), self._threads)
        flat = Hits(hits.depth_m.reshape(-1), hits.normal.reshape(-1, 3), hits.body_index.reshape(-1))
        moving = scene.cast(rays.reshape(-1, 6)[pixels])
        nearer = moving.depth_m < flat.depth_m[pixels]
        for everywhere, of_moving in zip(flat, moving, strict=True):
            everywhere[pixels[nearer]] = of_moving[nearer]


class RaycastScene:
    """Meshes in the world frame in an acceleration structure for ray casting.

    A hit reports the body index of its triangle, and a ray without a hit reports `no_body`.
    """

    def __init__(self, meshes: Sequence[Mesh], body_of_triangle: IdImage, no_body: int, threads: int) -> None:
        self._o3d = open3d()
        self._threads = threads
        self._scene = self._o3d.t.geometry.RaycastingScene()
        self._index = np.append(body_of_triangle, np.int32(no_body))
        if meshes:
            mesh = merged(meshes)
            vertices = self._o3d.core.Tensor(mesh.vertices_m.astype(np.float32))
            self._scene.add_triangles(vertices, self._o3d.core.Tensor(mesh.triangles))

    def cast(self, rays: Rays) -> Hits:
        """The first hit of each ray; rays have shape (..., 6)."""
        answer = self._scene.cast_rays(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        triangle = np.minimum(answer["primitive_ids"].numpy(), len(self._index) - 1)
        return Hits(answer["t_hit"].numpy(), answer["primitive_normals"].numpy(), self._index[triangle])

    def is_blocked(self, rays: Rays) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything; rays have shape (..., 6)."""
        answer = self._scene.test_occlusions(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        return np.asarray(answer.numpy())


def pixel_bounds(cameras: Sequence[Camera], centers_m: FloatArray, radii_m: FloatArray) -> npt.NDArray[np.intp]:
    """Image rectangles that contain the projections of spheres with centres of shape (n, 3) and radii of shape (n,).

    All cameras have the same intrinsics. The result has rows of (camera, top, bottom, left, right), ends exclusive,
    shape (m, 5). A sphere that is behind a camera or outside of its image has no row.
    """
    i = cameras[0].intrinsics
    T = np.stack([camera.T_world_cam for camera in cameras])
    x, y, z = np.moveaxis((centers_m - T[:, None, :3, 3]) @ T[:, :3, :3], -1, 0)
    (left, right), (top, bottom) = _tangents(x, z, radii_m), _tangents(y, z, radii_m)
    low = np.floor(np.stack([i.cy_px + i.fy_px * top, i.cx_px + i.fx_px * left]))
    high = np.ceil(np.stack([i.cy_px + i.fy_px * bottom, i.cx_px + i.fx_px * right])) + 1
    size_px = np.array(i.shape).reshape(2, 1, 1)
    (top, left), (bottom, right) = np.clip(low, 0, size_px), np.clip(high, 0, size_px)
    seen = (z > -radii_m) & (top < bottom) & (left < right)
    return np.stack([np.nonzero(seen)[0], *(edge[seen] for edge in (top, bottom, left, right))], axis=1).astype(np.intp)


def _tangents(across_m: FloatArray, z_m: FloatArray, radii_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Slopes `across / z` of the two tangents of circles; very large where a tangent misses the image plane."""
    angle = np.arctan2(across_m, z_m)
    ratio = radii_m / np.maximum(np.hypot(across_m, z_m), 1e-9)
    half = np.where(ratio < 1, np.arcsin(np.minimum(1, ratio)), 2 * np.pi)
    limit = np.pi / 2 - 1e-6
    return np.tan(np.clip(angle - half, -limit, limit)), np.tan(np.clip(angle + half, -limit, limit))
