"""Ray casting with Embree, through Open3D. A visibility backend finds the first surface behind each pixel."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray, FloatImage, Intrinsics

from ..bodies import Mesh
from ..types import Camera, IdImage, Pinhole
from .meshes import SceneMeshes, merged, open3d

Rays = npt.NDArray[np.float32]
"""Origin and direction in the world frame, shape (..., 6). Directions have z = 1 in their camera's frame, so that the
ray parameter is the depth."""


class Hits(NamedTuple):
    """First hits of the rays of an image."""

    depth_m: FloatImage
    """Depth [m], shape (H, W); +inf without a hit."""
    triangle: IdImage
    """Index into the triangles of all meshes, or their number without a hit, shape (H, W)."""


class RayCaster:
    """A visibility backend that casts a ray through every pixel.

    The fixed bodies form one ray casting scene, which is built once. The moving bodies form a second one, which is
    rebuilt for every batch. Only the rays near the bounding spheres of moving bodies are cast into it.
    """

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        moving = meshes.meshes[meshes.n_fixed :]
        self._radii_m = np.array([np.linalg.norm(mesh.vertices_m, axis=1).max() for mesh in moving])
        self._n_fixed_triangles = int(np.searchsorted(meshes.body_of_triangle, meshes.n_fixed))
        self._fixed = RaycastScene(meshes.fixed_in_world(), threads)

    def first_hits(self, cameras: Sequence[Camera]) -> list[Hits]:
        """The first hits of the pixels of each camera, with the bodies at their poses of the last update."""
        rays = np.stack([rays_of(camera) for camera in cameras])
        depth_m, triangle = self._fixed.cast(rays)
        triangle[np.isinf(depth_m)] = len(self._meshes.body_of_triangle)
        if len(self._radii_m):
            self._add_moving(cameras, rays, depth_m.reshape(-1), triangle.reshape(-1))
        shape = cameras[0].intrinsics.shape
        return [Hits(d.reshape(shape).copy(), t.reshape(shape)) for d, t in zip(depth_m, triangle, strict=True)]

    def _add_moving(self, cameras: Sequence[Camera], rays: Rays, depth_m: FloatImage, triangle: IdImage) -> None:
        """Replace the hits of all pixels where a moving body is nearer."""
        n_fixed = self._meshes.n_fixed
        bounds = pixel_bounds(cameras, self._meshes.position_m[n_fixed:], self._radii_m)
        if len(bounds) == 0:
            return
        height, width = cameras[0].intrinsics.shape
        pixels = np.concatenate(  # A pixel that two spheres may cover occurs twice.
            [
                (((k * height + np.arange(top, bottom)) * width)[:, None] + np.arange(left, right)).ravel()
                for k, top, bottom, left, right in bounds.tolist()
            ]
        )
        scene = RaycastScene(self._meshes.moving_in_world(), self._threads)
        depth_of_moving_m, moving = scene.cast(rays.reshape(-1, 6)[pixels])
        nearer = depth_of_moving_m < depth_m[pixels]
        depth_m[pixels[nearer]] = depth_of_moving_m[nearer]
        triangle[pixels[nearer]] = moving[nearer] + self._n_fixed_triangles


class RaycastScene:
    """Meshes in the world frame in an acceleration structure for ray casting."""

    def __init__(self, meshes: Sequence[Mesh], threads: int) -> None:
        self._o3d = open3d()
        self._threads = threads
        self._scene = self._o3d.t.geometry.RaycastingScene()
        if meshes:
            mesh = merged(meshes)
            vertices = self._o3d.core.Tensor(mesh.vertices_m.astype(np.float32))
            self._scene.add_triangles(vertices, self._o3d.core.Tensor(mesh.triangles))

    def cast(self, rays: Rays) -> tuple[FloatImage, IdImage]:
        """Depth of the first hit of each ray, +inf without one, and the index of its triangle; rays are (..., 6)."""
        answer = self._scene.cast_rays(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        return answer["t_hit"].numpy(), answer["primitive_ids"].numpy().astype(np.int32)

    def is_blocked(self, rays: Rays) -> npt.NDArray[np.bool_]:
        """Whether each ray hits anything; rays have shape (..., 6)."""
        answer = self._scene.test_occlusions(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        return np.asarray(answer.numpy())


def rays_of(camera: Camera) -> Rays:
    """The rays of a camera's pixels in raster order, shape (H * W, 6)."""
    rays = np.empty((camera.pinhole.height_px * camera.pinhole.width_px, 6), np.float32)
    rays[:, :3] = camera.T_world_cam[:3, 3]
    rotation = camera.T_world_cam[:3, :3].astype(np.float32)
    np.matmul(unit_depth_directions(camera.pinhole), rotation.T, out=rays[:, 3:])
    return rays


@lru_cache(maxsize=8)
def unit_depth_directions(intrinsics: Intrinsics | Pinhole) -> Rays:
    """Ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)


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
