"""Ray casting by Embree through Open3D: the fast renderer on a CPU."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pybullet
import warp as wp

from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics

from .. import frames
from ..errors import RenderError
from ..open3d_import import open3d
from ..scenes import Surface
from ..seeds import Purpose, stream
from ..types import Camera, IdImage, Images
from ..world import DRONE_SURFACE, World
from . import shading
from .meshes import Mesh, merged, mesh_of_body

SUN_DIRECTION = np.array([0.45, -0.35, 0.82]) / np.linalg.norm([0.45, -0.35, 0.82])

Rays = npt.NDArray[np.float32]


class Hits(NamedTuple):
    """What rays hit first; of one camera, or of several along a first axis."""

    depth_m: FloatImage
    """+inf where nothing is hit."""
    normal: FloatImage
    """Not normalised, shape (..., 3)."""
    body_index: IdImage
    """Position of the body in the renderer's list; the last value, one past the bodies, stands for nothing."""


class RaycastRenderer:
    """Mirrors the visual shapes of a PyBullet world and renders a batch of cameras at once.

    All bodies form one mesh, which is rebuilt with the drones' present poses for every batch: for worlds of some
    thousand triangles that costs less than a second cast at the drones alone. All cameras of a batch must have the same
    intrinsics.
    """

    def __init__(self, world: World, *, threads: int) -> None:
        self._world = world
        self._o3d = open3d()
        static = list(world.bodies)
        self._static_mesh = merged([self._placed(body) for body in static])
        self._drone_meshes = [mesh_of_body(body, world.client) for body in world.drone_ids]
        self._body_ids = [*static, *world.drone_ids]
        self._n_static = len(static)
        sizes = [len(mesh_of_body(body, world.client).triangles) for body in self._body_ids]
        nothing = len(sizes)
        self._index_of_triangle = np.append(np.repeat(np.arange(nothing, dtype=np.int32), sizes), np.int32(nothing))
        self._segment_of_index = np.array([*self._body_ids, -1], np.int32)
        surfaces = [world.bodies[body].surface for body in static] + [DRONE_SURFACE] * world.n_drones
        self._looks = self._make_looks(surfaces)
        self._sky_seed = int(stream(world.scene.seed, Purpose.SURFACE, 1).integers(1 << 30))
        self._directions: dict[Intrinsics, Rays] = {}
        self._buffer: Rays = np.empty((0, 0, 6), np.float32)
        self._pool = ThreadPoolExecutor(threads)
        self._threads = threads
        wp.load_module(shading, device="cpu")

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now; without `gray` those images are black."""
        if not cameras:
            return []
        intrinsics = cameras[0].intrinsics
        if any(camera.intrinsics != intrinsics for camera in cameras):
            raise RenderError("all cameras of a batch must have the same intrinsics: render them in separate calls")
        rays = self._ray_buffer((len(cameras), intrinsics.width_px * intrinsics.height_px, 6))
        list(self._pool.map(self._fill_rays, cameras, rays))
        hits = self._cast(rays)
        looks = wp.array(self._looks, dtype=shading.BodyLook, device="cpu")

        def finish(i: int) -> Images:
            hit = Hits(*(array[i] for array in hits))
            brightness = self._shade(intrinsics, rays[i], hit, looks) if gray else np.zeros(len(rays[i]), np.uint8)
            return Images(
                gray=brightness.reshape(intrinsics.shape),
                depth_m=hit.depth_m.reshape(intrinsics.shape),
                segment_id=self._segment_of_index[hit.body_index].reshape(intrinsics.shape),
            )

        return list(self._pool.map(finish, range(len(cameras))))

    def _ray_buffer(self, shape: tuple[int, int, int]) -> Rays:
        """Memory for the rays of a batch, kept between batches of one size."""
        if self._buffer.shape != shape:
            self._buffer = np.empty(shape, np.float32)
        return self._buffer

    def _cast(self, rays: Rays) -> Hits:
        """The first hit of each ray."""
        mesh = merged([self._static_mesh, *self._place_drones()])
        scene = self._o3d.t.geometry.RaycastingScene()
        scene.add_triangles(
            self._o3d.core.Tensor(mesh.vertices_m.astype(np.float32)), self._o3d.core.Tensor(mesh.triangles)
        )
        answer = scene.cast_rays(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        triangle = np.minimum(answer["primitive_ids"].numpy(), len(mesh.triangles))
        return Hits(answer["t_hit"].numpy(), answer["primitive_normals"].numpy(), self._index_of_triangle[triangle])

    def _make_looks(self, surfaces: list[Surface]) -> Any:
        looks = np.zeros(len(surfaces), shading.BodyLook.numpy_dtype())  # type: ignore[attr-defined]
        seeds = stream(self._world.scene.seed, Purpose.SURFACE, 0).integers(1 << 30, size=len(surfaces))
        for i, (surface, body) in enumerate(zip(surfaces, self._body_ids, strict=True)):
            looks[i]["albedo"] = surface.albedo
            looks[i]["texture"] = surface.texture
            looks[i]["pattern"] = shading.PATTERNS[surface.pattern]
            looks[i]["seed"] = seeds[i]
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
        for i, (body, mesh) in enumerate(zip(self._world.drone_ids, self._drone_meshes, strict=True)):
            rotation, position_m = self._pose(body)
            self._looks[self._n_static + i]["rotation"] = rotation
            self._looks[self._n_static + i]["position"] = position_m
            placed.append(_moved(mesh, rotation, position_m))
        return placed

    def _fill_rays(self, camera: Camera, rays: Rays) -> None:
        """Write the rays of a camera, (origin, direction of unit depth), into an array of shape (H * W, 6)."""
        if camera.intrinsics not in self._directions:
            self._directions[camera.intrinsics] = _unit_depth_directions(camera.intrinsics)
        rays[:, :3] = camera.T_world_cam[:3, 3]
        rays[:, 3:] = self._directions[camera.intrinsics] @ camera.T_world_cam[:3, :3].T.astype(np.float32)

    def _shade(self, intrinsics: Intrinsics, rays: Rays, hit: Hits, looks: Any) -> GrayImage:
        gray = np.empty(len(rays), np.uint8)
        wp.launch(
            shading.shade,
            len(rays),
            inputs=[
                _view(rays, wp.float32),
                intrinsics.fx_px,
                wp.vec3(*SUN_DIRECTION),
                self._sky_seed,
                _view(hit.depth_m, wp.float32),
                _view(hit.normal, wp.vec3),
                _view(hit.body_index, wp.int32),
                looks,
            ],
            outputs=[_view(gray, wp.uint8)],
            device="cpu",
        )
        return gray


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
