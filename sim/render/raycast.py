"""Ray casting by Embree through Open3D: the fast renderer on a CPU."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet
import warp as wp

from voxdepth.types import FloatArray, Intrinsics

from .. import frames
from ..open3d_import import open3d
from ..scenes import Surface
from ..seeds import Purpose, stream
from ..types import Camera, Images
from ..world import DRONE_SURFACE, World
from . import shading
from .meshes import Mesh, mesh_of_body

SUN_DIRECTION = np.array([0.45, -0.35, 0.82]) / np.linalg.norm([0.45, -0.35, 0.82])
SHADING_THREADS = 2

Rays = npt.NDArray[np.float32]
Hits = tuple[npt.NDArray[Any], ...]


class RaycastRenderer:
    """Mirrors the visual shapes of a PyBullet world and renders a batch of cameras at once.

    Static bodies are built once; drones live in a second, small scene that is rebuilt for every batch. All cameras of
    a batch must have the same intrinsics.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._o3d = open3d()
        static = list(world.bodies)
        self._static_scene = self._build([self._placed(body) for body in static])
        self._moving_meshes = [mesh_of_body(body, world.client) for body in world.drone_ids]
        surfaces = [world.bodies[body].surface for body in static] + [DRONE_SURFACE] * world.n_drones
        self._n_static = len(static)
        self._body_ids = [*static, *world.drone_ids]
        self._looks = self._make_looks(surfaces)
        self._sky_seed = int(stream(world.scene.seed, Purpose.SURFACE, 1).integers(1 << 30))
        self._directions: dict[Intrinsics, Rays] = {}
        self._pool = ThreadPoolExecutor(SHADING_THREADS)
        wp.load_module(shading, device="cpu")

    def render(self, cameras: Sequence[Camera]) -> list[Images]:
        """One `Images` per camera, of the world as it is now."""
        if not cameras:
            return []
        rays = np.stack([self._rays(camera) for camera in cameras])
        batch = self._o3d.core.Tensor(rays)
        static = _hits(self._static_scene.cast_rays(batch))
        moving = _hits(self._build(self._place_drones()).cast_rays(batch))
        looks = wp.array(self._looks, dtype=shading.BodyLook, device="cpu")

        def finish(i: int) -> Images:
            return self._shade(cameras[i].intrinsics, rays[i], static, moving, i, looks)

        return list(self._pool.map(finish, range(len(cameras))))

    def _make_looks(self, surfaces: list[Surface]) -> Any:
        looks = np.zeros(len(surfaces), shading.BodyLook.numpy_dtype())
        seeds = stream(self._world.scene.seed, Purpose.SURFACE, 0).integers(1 << 30, size=len(surfaces))
        for i, (surface, body) in enumerate(zip(surfaces, self._body_ids, strict=True)):
            looks[i]["albedo"] = surface.albedo
            looks[i]["texture"] = surface.texture
            looks[i]["pattern"] = shading.PATTERNS[surface.pattern]
            looks[i]["seed"] = seeds[i]
            looks[i]["body_id"] = body
            looks[i]["rotation"], looks[i]["position"] = self._pose(body)
        return looks

    def _pose(self, body: int) -> tuple[FloatArray, FloatArray]:
        position_m, q_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._world.client)
        return frames.rotation_from_quaternion(np.array(q_xyzw)), np.array(position_m)

    def _placed(self, body: int) -> Mesh:
        return _moved(mesh_of_body(body, self._world.client), *self._pose(body))

    def _place_drones(self) -> list[Mesh]:
        """The drones' meshes where they are now; their looks follow."""
        placed = []
        for i, (body, mesh) in enumerate(zip(self._world.drone_ids, self._moving_meshes, strict=True)):
            rotation, position_m = self._pose(body)
            self._looks[self._n_static + i]["rotation"] = rotation
            self._looks[self._n_static + i]["position"] = position_m
            placed.append(_moved(mesh, rotation, position_m))
        return placed

    def _build(self, meshes: list[Mesh]) -> Any:
        scene = self._o3d.t.geometry.RaycastingScene()
        for mesh in meshes:
            vertices = self._o3d.core.Tensor(mesh.vertices_m.astype(np.float32))
            scene.add_triangles(vertices, self._o3d.core.Tensor(mesh.triangles))
        return scene

    def _rays(self, camera: Camera) -> Rays:
        if camera.intrinsics not in self._directions:
            self._directions[camera.intrinsics] = _unit_depth_directions(camera.intrinsics)
        directions = self._directions[camera.intrinsics]
        rays = np.empty((len(directions), 6), np.float32)
        rays[:, :3] = camera.T_world_cam[:3, 3]
        rays[:, 3:] = directions @ camera.T_world_cam[:3, :3].T.astype(np.float32)
        return rays

    def _shade(self, intrinsics: Intrinsics, rays: Rays, static: Hits, moving: Hits, camera: int, looks: Any) -> Images:
        depth_m = np.empty(len(rays), np.float32)
        segment_id = np.empty(len(rays), np.int32)
        gray = np.empty(len(rays), np.uint8)
        wp.launch(
            shading.shade,
            len(rays),
            inputs=[
                _view(rays, wp.float32), intrinsics.fx_px, wp.vec3(*SUN_DIRECTION), self._sky_seed,
                *_warp_hits(static, camera), *_warp_hits(moving, camera), looks, self._n_static,
            ],
            outputs=[_view(depth_m, wp.float32), _view(segment_id, wp.int32), _view(gray, wp.uint8)],
            device="cpu",
        )
        shape = intrinsics.shape
        return Images(gray=gray.reshape(shape), depth_m=depth_m.reshape(shape), segment_id=segment_id.reshape(shape))


def _hits(answer: Any) -> Hits:
    """Distances, bodies and normals of all rays, in NumPy; the first axis is the camera."""
    return tuple(answer[key].numpy() for key in ("t_hit", "geometry_ids", "primitive_normals"))


def _warp_hits(hits: Hits, camera: int) -> list[Any]:
    """The hits of one camera as Warp arrays over the same memory."""
    t, body, normal = (array[camera] for array in hits)
    return [_view(t, wp.float32), _view(body, wp.uint32), _view(normal, wp.vec3)]


def _view(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A NumPy array as a Warp array over the same memory."""
    return wp.array(array, dtype=dtype, copy=False, device="cpu")


def _moved(mesh: Mesh, rotation: FloatArray, position_m: FloatArray) -> Mesh:
    return Mesh(mesh.vertices_m @ rotation.T + position_m, mesh.triangles)


def _unit_depth_directions(intrinsics: Intrinsics) -> Rays:
    """Ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
