"""Rasterisation on a CPU, the fastest visibility backend for small images."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from voxdepth.types import FloatArray

from ..bodies import Mesh
from ..cpu import mapper, slices, warp_view
from ..types import Camera
from . import raster_kernels
from .meshes import SceneMeshes, merged
from .raycast import Hits, Rays


class Rasteriser:
    """A visibility backend that draws every triangle that may be in the image."""

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        self._map = mapper(threads)
        bodies = [*meshes.fixed, *meshes.moving]
        scene = merged(bodies)
        self._vertices_m = np.ascontiguousarray(scene.vertices_m)
        self._triangles = scene.triangles.astype(np.int32)
        self._first_vertex = np.cumsum([0, *(len(mesh.vertices_m) for mesh in bodies)]).astype(np.int32)
        self._first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in bodies)]).astype(np.int32)
        self._spheres = np.array([_bounding_sphere(mesh) for mesh in bodies])
        self._buffers = self._allocate((0, 0, 0))
        wp.load_module(raster_kernels, device="cpu")

    def first_hits(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """The first hit of each pixel, shape (cameras, H * W), in the present state of the world."""
        n_fixed, moving = self._meshes.n_fixed, self._meshes.moving_in_world()
        if moving:
            self._vertices_m[self._first_vertex[n_fixed] :] = np.concatenate([mesh.vertices_m for mesh in moving])
            self._spheres[n_fixed:] = [_bounding_sphere(mesh) for mesh in moving]
        shape = (len(cameras), *cameras[0].intrinsics.shape)
        if self._buffers.nearest.shape != shape:
            self._buffers = self._allocate(shape)
        views, size = _views(cameras), rays.shape[:2]
        hits = Hits(np.empty(size, np.float32), np.empty((*size, 3), np.float32), np.empty(size, np.int32))

        def draw(part: slice) -> None:
            buffers = _Buffers._make(array[part] for array in self._buffers)
            self._draw(views[part], buffers, Hits._make(array[part] for array in hits))

        list(self._map(draw, slices(len(cameras), self._threads)))
        return hits

    def _allocate(self, shape: tuple[int, int, int]) -> "_Buffers":
        n, vertices = shape[0], len(self._vertices_m)
        points = np.empty((n, vertices, 3)), np.empty((n, vertices, 2))
        return _Buffers(*points, inverse_depth=np.empty(shape), nearest=np.empty(shape, np.int32))

    def _draw(self, views: Any, buffers: "_Buffers", hits: Hits) -> None:
        scene = [warp_view(self._vertices_m, wp.vec3d), warp_view(self._triangles, wp.vec3i)]
        wp.launch(
            raster_kernels.rasterise,
            len(views),
            inputs=[
                wp.array(views, dtype=raster_kernels.View, device="cpu"),
                *scene,
                warp_view(self._first_vertex, wp.int32),
                warp_view(self._first_triangle, wp.int32),
                warp_view(self._spheres, wp.vec4d),
                warp_view(buffers.in_camera_m, wp.vec3d),
                warp_view(buffers.projected_px, wp.vec2d),
                warp_view(buffers.inverse_depth, wp.float64),
            ],
            outputs=[warp_view(buffers.nearest, wp.int32)],
            device="cpu",
        )
        body_of_triangle = warp_view(self._meshes.body_of_triangle, wp.int32)
        inverse_depth = warp_view(buffers.inverse_depth.reshape(-1), wp.float64)
        nearest = warp_view(buffers.nearest.reshape(-1), wp.int32)
        wp.launch(
            raster_kernels.resolve,
            buffers.nearest.size,
            inputs=[*scene, body_of_triangle, len(self._spheres), inverse_depth, nearest],
            outputs=[
                warp_view(hits.depth_m.reshape(-1), wp.float32),
                warp_view(hits.normal.reshape(-1, 3), wp.vec3),
                warp_view(hits.body_index.reshape(-1), wp.int32),
            ],
            device="cpu",
        )


class _Buffers(NamedTuple):
    """Buffers for a batch of images, which the next batch of the same size reuses. The first axis is the camera."""

    in_camera_m: FloatArray
    projected_px: FloatArray
    inverse_depth: FloatArray
    nearest: npt.NDArray[np.int32]


def _bounding_sphere(mesh: Mesh) -> FloatArray:
    """Centre and radius, shape (4,)."""
    center_m = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
    return np.append(center_m, np.sqrt(((mesh.vertices_m - center_m) ** 2).sum(axis=1).max()))


def _views(cameras: Sequence[Camera]) -> Any:
    """Cameras with the same intrinsics as an array of `raster_kernels.View`."""
    i = cameras[0].intrinsics
    T_world_cam = np.stack([camera.T_world_cam for camera in cameras])
    views: Any = np.zeros(len(cameras), raster_kernels.View.numpy_dtype())  # type: ignore[attr-defined]
    views["R_cam_world"] = np.linalg.inv(T_world_cam[:, :3, :3])
    views["origin_m"] = T_world_cam[:, :3, 3]
    views["focal_px"] = i.fx_px, i.fy_px
    views["center_px"] = i.cx_px, i.cy_px
    left, top = -i.cx_px / i.fx_px, -i.cy_px / i.fy_px
    right, bottom = (i.width_px - 1 - i.cx_px) / i.fx_px, (i.height_px - 1 - i.cy_px) / i.fy_px
    inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
    views["inward"] = inward / np.linalg.norm(inward, axis=1, keepdims=True)
    return views
