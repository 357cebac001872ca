"""Rasterisation on a CPU, the fastest visibility backend for small images."""

from collections.abc import Iterable, Sequence

import numpy as np

from voxdepth.compiled import compile_all
from voxdepth.types import FloatArray, Intrinsics

from ..cpu import mapper, slices
from ..types import Camera, IdImage
from . import raster_kernels
from .meshes import SceneMeshes, bounding_sphere, is_closed, merged
from .raycast import Hits


class Rasteriser:
    """A visibility backend that draws every triangle that may be in the image. It draws one batch at a time."""

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        self._map = mapper(threads)
        scene = merged([*meshes.fixed_in_world(), *meshes.moving_in_world()])
        self._vertices_m = np.ascontiguousarray(scene.vertices_m)
        self._triangles = np.ascontiguousarray(scene.triangles)
        self._first_vertex = _offsets(len(mesh.vertices_m) for mesh in meshes.meshes)
        self._first_triangle = _offsets(len(mesh.triangles) for mesh in meshes.meshes)
        self._own_spheres_m = np.array([bounding_sphere(mesh) for mesh in meshes.meshes])
        self._spheres_m = self._own_spheres_m.copy()
        self._is_closed = np.array([is_closed(mesh) for mesh in meshes.meshes])
        self._move(0)
        compile_all()

    def first_hits(self, cameras: Sequence[Camera]) -> list[Hits]:
        """The first hits of the pixels of each camera, with the bodies at their poses of the last update."""
        self._move(self._meshes.n_fixed)
        parts = self._map(self._draw, [cameras[part] for part in slices(len(cameras), self._threads)])
        return [hits for part in parts for hits in part]

    def _move(self, first: int) -> None:
        """Move the bodies from the first one on to where they are."""
        rotation, position_m = self._meshes.R_world_body, self._meshes.position_m
        for body in range(first, len(rotation)):
            own = slice(self._first_vertex[body], self._first_vertex[body + 1])
            self._vertices_m[own] = self._meshes.meshes[body].vertices_m @ rotation[body].T + position_m[body]
            self._spheres_m[body, :3] = rotation[body] @ self._own_spheres_m[body, :3] + position_m[body]

    def _draw(self, cameras: Sequence[Camera]) -> list[Hits]:
        i, most = cameras[0].intrinsics, np.diff(self._first_triangle).max()
        buffers = np.empty((len(self._vertices_m), 5)), np.empty((most, 9)), np.empty((most, 3), np.int32)
        inverse_depth = np.empty(i.shape)
        hits = []
        for camera in cameras:
            depth_m, triangle = np.empty(i.shape, np.float32), np.full(i.shape, len(self._triangles), np.int32)
            inverse_depth.fill(0)
            raster_kernels.rasterise(
                np.asarray(np.linalg.inv(camera.T_world_cam[:3, :3]), np.float64),
                np.ascontiguousarray(camera.T_world_cam[:3, 3]),
                np.array([i.fx_px, i.fy_px, i.cx_px, i.cy_px]),
                planes_around(i),
                self._vertices_m,
                self._triangles,
                self._first_vertex,
                self._first_triangle,
                self._spheres_m,
                self._is_closed,
                *i.shape,
                *buffers,
                inverse_depth.reshape(-1),
                triangle.reshape(-1),
            )
            raster_kernels.invert(inverse_depth.reshape(-1), depth_m.reshape(-1))
            hits.append(Hits(depth_m, triangle))
        return hits


def _offsets(lengths: Iterable[int]) -> IdImage:
    """Where each of several successive parts begins, and the end of the last one."""
    return np.cumsum([0, *lengths], dtype=np.int32)


def planes_around(i: Intrinsics) -> FloatArray:
    """Normals in the camera frame of the four planes that bound an image, shape (4, 3); they point inwards."""
    left, top = -i.cx_px / i.fx_px, -i.cy_px / i.fy_px
    right, bottom = (i.width_px - 1 - i.cx_px) / i.fx_px, (i.height_px - 1 - i.cy_px) / i.fy_px
    inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
    return np.asarray(inward / np.linalg.norm(inward, axis=1, keepdims=True))
