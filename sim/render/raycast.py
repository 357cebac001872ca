"""Ray casting with Embree, through Open3D. A visibility backend finds the first surface behind each pixel."""

import ctypes
from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import matmul
from voxdepth.types import FloatImage, Intrinsics

from ..bodies import Mesh
from ..errors import RenderError
from ..types import Camera, IdImage, Pinhole
from .meshes import SceneMeshes, merged

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
    rebuilt for every batch.
    """

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        self._n_fixed_triangles = int(np.searchsorted(meshes.body_of_triangle, meshes.moving.start))
        self._fixed = RaycastScene(meshes.in_world(meshes.fixed), threads)

    def first_hits(self, cameras: Sequence[Camera]) -> list[Hits]:
        """Return the first hits of the pixels of each camera, with the bodies at the poses that were read last."""
        rays = np.stack([rays_of(camera) for camera in cameras])
        depth_m, triangle = self._fixed.cast(rays)
        if moving := self._meshes.in_world(self._meshes.moving):
            depth_of_moving_m, triangle_of_moving = RaycastScene(moving, self._threads).cast(rays)
            nearer = depth_of_moving_m < depth_m
            depth_m[nearer] = depth_of_moving_m[nearer]
            triangle[nearer] = triangle_of_moving[nearer] + self._n_fixed_triangles
        triangle[np.isinf(depth_m)] = len(self._meshes.body_of_triangle)
        shape = cameras[0].intrinsics.shape
        return [Hits(d.reshape(shape).copy(), t.reshape(shape)) for d, t in zip(depth_m, triangle, strict=True)]


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
        """Return the depth of each ray's first hit, +inf without, and the index of its triangle; rays are (..., 6)."""
        answer = self._scene.cast_rays(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        return answer["t_hit"].numpy(), answer["primitive_ids"].numpy().astype(np.int32)

    def is_blocked(self, rays: Rays) -> npt.NDArray[np.bool_]:
        """Return whether each ray hits anything; rays have shape (..., 6)."""
        answer = self._scene.test_occlusions(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        return np.asarray(answer.numpy())


def rays_of(camera: Camera) -> Rays:
    """Return the rays of a camera's pixels in raster order, shape (H * W, 6)."""
    rays = np.empty((camera.intrinsics.height_px * camera.intrinsics.width_px, 6), np.float32)
    rays[:, :3] = camera.T_world_cam[:3, 3]
    rotation = camera.T_world_cam[:3, :3].astype(np.float32)
    rays[:, 3:] = matmul(unit_depth_directions(camera.intrinsics), rotation.T)
    return rays


@lru_cache(maxsize=8)
def unit_depth_directions(intrinsics: Intrinsics | Pinhole) -> Rays:
    """Return the ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)


@cache
def open3d() -> Any:
    """Return the module `open3d`, imported after libusb, which it needs and which the wheel `libusb-package` provides.

    A machine on which Open3D cannot be imported raises a `RenderError`.
    """
    try:
        import libusb_package

        ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
        import open3d as module
    except (ImportError, OSError) as error:
        raise RenderError(
            f"the raycast renderer needs Open3D of the extra 'sim', which does not load here ({error}): mend that, "
            "or use the renderer 'tiny'"
        ) from error
    return module
