"""Rasterising on a CPU: the fast way to find what cameras of few pixels see."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from voxdepth.types import FloatArray

from ..bodies import Mesh
from ..memory import on_cpu
from ..parallel import mapper, slices
from ..types import Camera
from . import triangles
from .hits import Hits, Rays
from .meshes import merged
from .mirror import Mirror


class Rasteriser:
    """Finds what cameras see by drawing every triangle that may be in the image."""

    def __init__(self, mirror: Mirror, threads: int) -> None:
        self._mirror = mirror
        self._threads = threads
        self._map = mapper(threads)
        meshes = [*mirror.fixed, *mirror.moving]
        scene = merged(meshes)
        self._vertices_m = np.ascontiguousarray(scene.vertices_m)
        self._triangles = scene.triangles.astype(np.int32)
        self._first_vertex = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes)]).astype(np.int32)
        self._first_triangle = np.cumsum([0, *(len(mesh.triangles) for mesh in meshes)]).astype(np.int32)
        self._spheres = np.array([_bounding_sphere(mesh) for mesh in meshes])
        self._scratch = _Scratch.empty((0, 0, 0), 0)
        wp.load_module(triangles, device="cpu")

    def look(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """The first hit of each pixel, shape (cameras, H * W)."""
        self._place_moving()
        shape = (len(cameras), *cameras[0].intrinsics.shape)
        if self._scratch.nearest.shape != shape:
            self._scratch = _Scratch.empty(shape, len(self._vertices_m))
        views = _views(cameras)
        n, pixels = rays.shape[:2]
        hits = Hits(
            depth_m=np.empty((n, pixels), np.float32),
            normal=np.empty((n, pixels, 3), np.float32),
            body_index=np.empty((n, pixels), np.int32),
        )

        def draw(part: slice) -> None:
            scratch = _Scratch._make(array[part] for array in self._scratch)
            self._draw(views[part], scratch, Hits._make(array[part] for array in hits))

        list(self._map(draw, slices(n, self._threads)))
        return hits

    def _place_moving(self) -> None:
        n = self._mirror.n_fixed
        moving = self._mirror.moving_now()
        if moving:
            self._vertices_m[self._first_vertex[n] :] = np.concatenate([mesh.vertices_m for mesh in moving])
            self._spheres[n:] = [_bounding_sphere(mesh) for mesh in moving]

    def _draw(self, views: Any, scratch: "_Scratch", hits: Hits) -> None:
        """Draw the scene for some of the cameras."""
        shape = [on_cpu(self._vertices_m, wp.vec3d), on_cpu(self._triangles, wp.vec3i)]
        wp.launch(
            triangles.rasterise,
            len(views),
            inputs=[
                wp.array(views, dtype=triangles.View, device="cpu"),
                *shape,
                on_cpu(self._first_vertex, wp.int32),
                on_cpu(self._first_triangle, wp.int32),
                on_cpu(self._spheres, wp.vec4d),
                on_cpu(scratch.in_camera_m, wp.vec3d),
                on_cpu(scratch.at_px, wp.vec2d),
                on_cpu(scratch.inverse_depth, wp.float64),
            ],
            outputs=[on_cpu(scratch.nearest, wp.int32)],
            device="cpu",
        )
        wp.launch(
            triangles.resolve,
            scratch.nearest.size,
            inputs=[
                *shape,
                on_cpu(self._mirror.body_of_triangle, wp.int32),
                len(self._spheres),
                on_cpu(scratch.inverse_depth.reshape(-1), wp.float64),
                on_cpu(scratch.nearest.reshape(-1), wp.int32),
            ],
            outputs=[
                on_cpu(hits.depth_m.reshape(-1), wp.float32),
                on_cpu(hits.normal.reshape(-1, 3), wp.vec3),
                on_cpu(hits.body_index.reshape(-1), wp.int32),
            ],
            device="cpu",
        )


class _Scratch(NamedTuple):
    """Memory for a batch of images, kept for the next one of the same size. Cameras come first."""

    in_camera_m: FloatArray
    at_px: FloatArray
    inverse_depth: FloatArray
    nearest: npt.NDArray[np.int32]

    @staticmethod
    def empty(shape: tuple[int, int, int], n_vertices: int) -> "_Scratch":
        """For images of shape (cameras, H, W)."""
        return _Scratch(
            in_camera_m=np.empty((shape[0], n_vertices, 3)),
            at_px=np.empty((shape[0], n_vertices, 2)),
            inverse_depth=np.empty(shape),
            nearest=np.empty(shape, np.int32),
        )


def _bounding_sphere(mesh: Mesh) -> FloatArray:
    """Centre and radius, shape (4,)."""
    center_m = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
    return np.append(center_m, np.sqrt(((mesh.vertices_m - center_m) ** 2).sum(axis=1).max()))


def _views(cameras: Sequence[Camera]) -> Any:
    """The cameras as the kernel wants them; all have the same intrinsics."""
    i = cameras[0].intrinsics
    T_world_cam = np.stack([camera.T_world_cam for camera in cameras])
    views: Any = np.zeros(len(cameras), triangles.View.numpy_dtype())  # type: ignore[attr-defined]
    views["R_cam_world"] = np.linalg.inv(T_world_cam[:, :3, :3])
    views["origin_m"] = T_world_cam[:, :3, 3]
    views["focal_px"] = i.fx_px, i.fy_px
    views["center_px"] = i.cx_px, i.cy_px
    left, top = -i.cx_px / i.fx_px, -i.cy_px / i.fy_px
    right, bottom = (i.width_px - 1 - i.cx_px) / i.fx_px, (i.height_px - 1 - i.cy_px) / i.fy_px
    inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
    views["inward"] = inward / np.linalg.norm(inward, axis=1, keepdims=True)
    return views
