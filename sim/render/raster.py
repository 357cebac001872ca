"""Rasterisation on a CPU, the fastest visibility backend for small images."""

from collections.abc import Iterable, Sequence

import numpy as np

from voxdepth.compiled import compile_all
from voxdepth.types import FloatArray

from ..cpu import mapper, slices
from ..errors import RenderError
from ..types import Camera, IdImage, Pinhole
from .meshes import SceneMeshes, bounding_sphere, is_closed, merged, normals
from .raster_kernels import Bodies, Buffers, View, invert, rasterise
from .raycast import Hits


class Rasteriser:
    """A visibility backend that draws every triangle that may be in the image. It draws one batch at a time."""

    def __init__(self, meshes: SceneMeshes, threads: int) -> None:
        self._meshes = meshes
        self._threads = threads
        self._map = mapper(threads)
        self._normals = [normals(mesh) for mesh in meshes.meshes]
        self._spheres_m = [bounding_sphere(mesh) for mesh in meshes.meshes]
        scene = merged(meshes.meshes)
        self._bodies = Bodies(
            vertices_m=np.ascontiguousarray(scene.vertices_m),
            triangles=np.ascontiguousarray(scene.triangles),
            faces=np.empty((len(scene.triangles), 4)),
            first_vertex=_offsets(len(mesh.vertices_m) for mesh in meshes.meshes),
            first_triangle=_offsets(len(mesh.triangles) for mesh in meshes.meshes),
            spheres_m=np.array(self._spheres_m),
            is_closed=np.array([is_closed(mesh) for mesh in meshes.meshes]),
        )
        self._place(range(len(meshes.meshes)))
        compile_all()

    def first_hits(self, cameras: Sequence[Camera]) -> list[Hits]:
        """The first hits of the pixels of each camera, with the bodies at their poses of the last update."""
        self._place(range(self._meshes.n_fixed, len(self._meshes.meshes)))
        parts = self._map(self._draw, [cameras[part] for part in slices(len(cameras), self._threads)])
        return [hits for part in parts for hits in part]

    def _place(self, moved: Iterable[int]) -> None:
        """Place some of the bodies where they are."""
        bodies = self._bodies
        for body in moved:
            R, position_m = self._meshes.R_world_body[body], self._meshes.position_m[body]
            vertices_m = bodies.vertices_m[bodies.first_vertex[body] : bodies.first_vertex[body + 1]]
            faces = bodies.faces[bodies.first_triangle[body] : bodies.first_triangle[body + 1]]
            vertices_m[:] = self._meshes.meshes[body].vertices_m @ R.T + position_m
            faces[:, :3] = self._normals[body] @ R.T
            faces[:, 3] = -(faces[:, :3] * vertices_m[self._meshes.meshes[body].triangles[:, 0]]).sum(axis=1)
            bodies.spheres_m[body, :3] = R @ self._spheres_m[body][:3] + position_m

    def _draw(self, cameras: Sequence[Camera]) -> list[Hits]:
        bodies = self._bodies
        most = int(np.diff(bodies.first_triangle).max())
        buffers = Buffers(
            corners=np.empty((len(bodies.vertices_m), 5)),
            chosen=np.empty(most, np.int32),
            planes=np.empty((most, 9)),
            rows=np.empty((most, 3), np.int32),
        )
        hits = []
        for camera in cameras:
            shape = camera.pinhole.shape
            depth_m, nearest = np.empty(shape, np.float32), np.full(shape, len(bodies.triangles), np.int32)
            inverse_depth = np.zeros(shape)
            view = view_of(camera)
            ahead_m = (bodies.spheres_m[:, :3] - view.origin_m) @ view.R_cam_world[2] - bodies.spheres_m[:, 3]
            order = np.argsort(ahead_m, kind="stable").astype(np.int32)
            rasterise(view, bodies, order, buffers, inverse_depth.reshape(-1), nearest.reshape(-1))
            invert(inverse_depth.reshape(-1), depth_m.reshape(-1))
            hits.append(Hits(depth_m, nearest))
        return hits


def view_of(camera: Camera) -> View:
    """A camera as the loops of rasterisation read it."""
    i, T = camera.pinhole, camera.T_world_cam
    return View(
        R_cam_world=np.linalg.inv(T[:3, :3]).astype(np.float64),
        origin_m=T[:3, 3].astype(np.float64),
        fx_px=i.fx_px,
        fy_px=i.fy_px,
        cx_px=i.cx_px,
        cy_px=i.cy_px,
        inward=_inward(i),
        farthest=_farthest(camera),
        height=i.height_px,
        width=i.width_px,
    )


def _farthest(camera: Camera) -> FloatArray:
    """The inverse depth at which the ray of a pixel passes the plane of a camera, shape (3,); see `View.farthest`."""
    if camera.beyond is None:
        return np.array([np.inf, 0, 0])
    i, T, normal = camera.pinhole, camera.T_world_cam, camera.beyond[:3]
    distance_m = -float(normal @ T[:3, 3] + camera.beyond[3])
    if distance_m <= 0:
        raise RenderError(f"the plane must be between the camera and what it sees, got one {-distance_m:g} m behind it")
    x, y, z = T[:3, :3].T @ normal / distance_m
    return np.array([z - x * i.cx_px / i.fx_px - y * i.cy_px / i.fy_px, x / i.fx_px, y / i.fy_px])


def _inward(i: Pinhole) -> FloatArray:
    """Normals in the camera frame of the four planes that bound an image, shape (4, 3); they point inwards."""
    left, top = -i.cx_px / i.fx_px, -i.cy_px / i.fy_px
    right, bottom = (i.width_px - 1 - i.cx_px) / i.fx_px, (i.height_px - 1 - i.cy_px) / i.fy_px
    inward = np.array([[1, 0, -left], [-1, 0, right], [0, 1, -top], [0, -1, bottom]])
    return np.asarray(inward / np.linalg.norm(inward, axis=1, keepdims=True), np.float64)


def _offsets(lengths: Iterable[int]) -> IdImage:
    """Where each of several successive parts begins, and the end of the last one."""
    return np.cumsum([0, *lengths], dtype=np.int32)
