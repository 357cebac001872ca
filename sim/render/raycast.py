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
from ..bodies import Mesh, Surface
from ..errors import RenderError
from ..open3d_import import open3d
from ..seeds import Purpose, stream
from ..types import Camera, IdImage, Images
from ..world import World
from . import shading
from .culling import pixel_bounds
from .meshes import merged, mesh_of_body, moved

Rays = npt.NDArray[np.float32]


SHADOW_BIAS_M = 0.01
"""Shadow rays start this far above a surface, or it would shade itself."""


class Hits(NamedTuple):
    """What rays hit first; the arrays share their leading axes."""

    depth_m: FloatImage
    """+inf where nothing is hit."""
    normal: FloatImage
    """Not normalised, shape (..., 3)."""
    body_index: IdImage
    """Position of the body in the renderer's list; the last value, one past the bodies, stands for nothing."""


class RaycastRenderer:
    """Mirrors the visual shapes of a PyBullet world and renders a batch of cameras at once.

    Static bodies form one scene that is built once. What may move, drones and movers, forms a second one, rebuilt with
    their present poses for every batch, at which only the rays near each of them are cast. All cameras of a batch must
    have the same intrinsics.
    """

    def __init__(self, world: World, *, threads: int) -> None:
        self._world = world
        self._threads = threads
        static = list(world.bodies)
        self._body_ids = [*static, *world.moving_ids]
        meshes = [mesh_of_body(world, body) for body in self._body_ids]
        self._n_static = len(static)
        self._moving_meshes = meshes[self._n_static :]
        self._moving_radii_m = np.array([np.linalg.norm(m.vertices_m, axis=1).max() for m in self._moving_meshes])
        index = np.repeat(np.arange(len(meshes), dtype=np.int32), [len(mesh.triangles) for mesh in meshes])
        first_moving = sum(len(mesh.triangles) for mesh in meshes[: self._n_static])
        placed = [moved(mesh, *self._pose(body)) for mesh, body in zip(meshes, static, strict=False)]
        self._static = _Target(placed, index[:first_moving], len(meshes), threads)
        self._moving_index = index[first_moving:]
        self._segment_of_index = np.array([*self._body_ids, -1], np.int32)
        self._looks = self._make_looks([world.surfaces[body] for body in self._body_ids])
        clouds_seed = int(stream(world.scene.seed, Purpose.SURFACE, 1).integers(1 << 30))
        self._air = shading.air(world.scene.weather, clouds_seed)
        self._directions: dict[Intrinsics, Rays] = {}
        self._buffer: Rays = np.empty((0, 0, 6), np.float32)
        self._pool = ThreadPoolExecutor(threads)
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
        hits = self._static.cast(rays)
        self._add_moving(cameras, rays, hits)
        sunlit = self._sunlit(rays, hits, gray=gray)
        looks = wp.array(self._looks, dtype=shading.BodyLook, device="cpu")

        def finish(i: int) -> Images:
            hit = Hits(*(array[i] for array in hits))
            lit = self._shade(intrinsics, rays[i], hit, sunlit[i], looks) if gray else np.zeros(len(rays[i]), np.uint8)
            return Images(
                gray=lit.reshape(intrinsics.shape),
                depth_m=hit.depth_m.reshape(intrinsics.shape).copy(),  # of its own: Open3D holds the whole batch
                segment_id=self._segment_of_index[hit.body_index].reshape(intrinsics.shape),
            )

        return list(self._pool.map(finish, range(len(cameras))))

    def _ray_buffer(self, shape: tuple[int, int, int]) -> Rays:
        """Memory for the rays of a batch, kept between batches of one size."""
        if self._buffer.shape != shape:
            self._buffer = np.empty(shape, np.float32)
        return self._buffer

    def _fill_rays(self, camera: Camera, rays: Rays) -> None:
        """Write the rays of a camera, (origin, direction of unit depth), into an array of shape (H * W, 6)."""
        if camera.intrinsics not in self._directions:
            self._directions[camera.intrinsics] = _unit_depth_directions(camera.intrinsics)
        rays[:, :3] = camera.T_world_cam[:3, 3]
        rays[:, 3:] = self._directions[camera.intrinsics] @ camera.T_world_cam[:3, :3].T.astype(np.float32)

    def _add_moving(self, cameras: Sequence[Camera], rays: Rays, hits: Hits) -> None:
        """Overwrite hits where what moves is nearer; only pixels that its bounding sphere may cover are looked at."""
        if not self._moving_meshes:
            return
        poses = [self._pose(body) for body in self._body_ids[self._n_static :]]
        for look, (rotation, position_m) in zip(self._looks[self._n_static :], poses, strict=True):
            look["rotation"], look["position"] = rotation, position_m
        placed = [moved(mesh, *pose) for mesh, pose in zip(self._moving_meshes, poses, strict=True)]
        centers_m = np.array([position_m for _, position_m in poses])
        pixels = _pixels_near(cameras, centers_m, self._moving_radii_m)
        if len(pixels) == 0:
            return
        target = _Target(placed, self._moving_index, len(self._body_ids), self._threads)
        flat = Hits(hits.depth_m.reshape(-1), hits.normal.reshape(-1, 3), hits.body_index.reshape(-1))
        near = target.cast(rays.reshape(-1, 6)[pixels])
        nearer = near.depth_m < flat.depth_m[pixels]
        for everywhere, of_moving in zip(flat, near, strict=True):
            everywhere[pixels[nearer]] = of_moving[nearer]

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

    def _sunlit(self, rays: Rays, hits: Hits, *, gray: bool) -> FloatImage:
        """1 where the sun reaches what was hit, 0 in the shadow of a static body; shape like the depths."""
        sunlit = np.ones(hits.depth_m.shape, np.float32)
        if gray and self._world.scene.weather.shadows:
            cameras = list(self._pool.map(self._shadow_rays, rays, hits.depth_m, hits.normal))
            blocked = self._static.blocked(np.concatenate([towards_sun for _, towards_sun in cameras]))
            ends = np.cumsum([len(pixels) for pixels, _ in cameras])
            for lit, (pixels, _), part in zip(sunlit, cameras, np.split(blocked, ends[:-1]), strict=True):
                lit[pixels[part]] = 0
        return sunlit

    def _shadow_rays(self, rays: Rays, depth_m: FloatImage, normal: FloatImage) -> tuple[npt.NDArray[np.intp], Rays]:
        """The pixels of one camera whose surface faces the sun, and rays from there towards it."""
        to_sun = np.array(self._air.sun, np.float32)
        pixels = np.flatnonzero(np.isfinite(depth_m) & (normal @ to_sun > 0))
        towards_sun = rays[pixels]
        towards_sun[:, :3] += depth_m[pixels, None] * towards_sun[:, 3:] + SHADOW_BIAS_M * to_sun
        towards_sun[:, 3:] = to_sun
        return pixels, towards_sun

    def _shade(self, intrinsics: Intrinsics, rays: Rays, hit: Hits, sunlit: FloatImage, looks: Any) -> GrayImage:
        gray = np.empty(len(rays), np.uint8)
        wp.launch(
            shading.shade,
            len(rays),
            inputs=[
                _view(rays, wp.float32),
                intrinsics.fx_px,
                self._air,
                _view(hit.depth_m, wp.float32),
                _view(hit.normal, wp.vec3),
                _view(hit.body_index, wp.int32),
                _view(sunlit, wp.float32),
                looks,
            ],
            outputs=[_view(gray, wp.uint8)],
            device="cpu",
        )
        return gray


class _Target:
    """Meshes to cast rays at."""

    def __init__(self, meshes: Sequence[Mesh], index_of_triangle: IdImage, nothing: int, threads: int) -> None:
        self._o3d = open3d()
        self._threads = threads
        self._scene = self._o3d.t.geometry.RaycastingScene()
        self._index = np.append(index_of_triangle, np.int32(nothing))
        if meshes:
            mesh = merged(meshes)
            vertices = self._o3d.core.Tensor(mesh.vertices_m.astype(np.float32))
            self._scene.add_triangles(vertices, self._o3d.core.Tensor(mesh.triangles))

    def cast(self, rays: Rays) -> Hits:
        """The first hit of each ray; rays have shape (..., 6)."""
        answer = self._scene.cast_rays(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        triangle = np.minimum(answer["primitive_ids"].numpy(), len(self._index) - 1)
        return Hits(answer["t_hit"].numpy(), answer["primitive_normals"].numpy(), self._index[triangle])

    def blocked(self, rays: Rays) -> npt.NDArray[np.bool_]:
        """Whether rays, shape (..., 6), hit anything."""
        answer = self._scene.test_occlusions(self._o3d.core.Tensor.from_numpy(rays), nthreads=self._threads)
        hit: npt.NDArray[np.bool_] = answer.numpy()
        return hit


def _view(array: npt.NDArray[Any], dtype: Any) -> Any:
    """A NumPy array as a Warp array over the same memory."""
    return wp.array(array, dtype=dtype, copy=False, device="cpu")


def _pixels_near(cameras: Sequence[Camera], centers_m: FloatArray, radii_m: FloatArray) -> npt.NDArray[np.intp]:
    """Indices into all pixels of a batch that spheres may cover; pixels that two spheres share come twice."""
    height, width = cameras[0].intrinsics.shape
    parts = [np.empty(0, np.intp)]
    for camera, top, bottom, left, right in pixel_bounds(cameras, centers_m, radii_m).tolist():
        rows = (camera * height + np.arange(top, bottom)) * width
        parts.append((rows[:, None] + np.arange(left, right)).ravel())
    return np.concatenate(parts)


def _unit_depth_directions(intrinsics: Intrinsics) -> Rays:
    """Ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)
