"""Images from the hits of a visibility backend: shading, shadows, depth and segmentation."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from voxdepth.types import FloatImage, GrayImage, Intrinsics

from ..bodies import Surface
from ..cpu import mapper, slices, warp_view
from ..errors import RenderError
from ..seeds import Purpose, stream
from ..types import Camera, Images
from ..world import World
from . import shading_kernels
from .meshes import SceneMeshes
from .raster import Rasteriser
from .raycast import Hits, RayCaster, RaycastScene, Rays

SHADOW_BIAS_M = 0.01
"""Distance above a surface at which shadow rays start, so that the surface does not shade itself."""


class ShadedRenderer:
    """Renders a batch of cameras with the same intrinsics. The number of threads changes only the speed."""

    def __init__(self, world: World, backend: type[Rasteriser] | type[RayCaster], *, threads: int) -> None:
        self._meshes = meshes = SceneMeshes(world)
        self._backend = backend(meshes, threads)
        self._segment_of_index = np.array([*meshes.body_ids, -1], np.int32)
        self._bodies = _shaded_bodies(world.scene.seed, [world.surfaces[body] for body in meshes.body_ids], meshes)
        weather, cloud_seed = world.scene.weather, stream(world.scene.seed, Purpose.SURFACE, 1).integers(1 << 30)
        self._atmosphere = shading_kernels.atmosphere(weather, int(cloud_seed))
        self._casters = RaycastScene(meshes.fixed, np.empty(0, np.int32), 0, threads) if weather.shadows else None
        self._directions: dict[Intrinsics, Rays] = {}
        self._rays: Rays = np.empty((0, 0, 6), np.float32)
        self._threads = threads
        self._map = mapper(threads)
        wp.load_module(shading_kernels, device="cpu")

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera of the present state of the world. Without `gray`, the gray images are black.

        Cameras with different intrinsics raise a `RenderError`.
        """
        if not cameras:
            return []
        intrinsics = cameras[0].intrinsics
        if any(camera.intrinsics != intrinsics for camera in cameras):
            raise RenderError("all cameras of a batch must have the same intrinsics: render them in separate calls")
        shape = (len(cameras), intrinsics.width_px * intrinsics.height_px, 6)
        if self._rays.shape != shape:
            self._rays = np.empty(shape, np.float32)
        rays = self._rays
        list(self._map(self._fill_rays, cameras, rays))
        hits = self._backend.first_hits(cameras, rays)
        brightness = self._shade(intrinsics, rays, hits) if gray else np.zeros(rays.shape[:2], np.uint8)
        return [
            Images(  # Copies, because views would keep the whole batch alive.
                gray=brightness[i].reshape(intrinsics.shape).copy(),
                depth_m=hits.depth_m[i].reshape(intrinsics.shape).copy(),
                segment_id=self._segment_of_index[hits.body_index[i]].reshape(intrinsics.shape),
            )
            for i in range(len(cameras))
        ]

    def _fill_rays(self, camera: Camera, rays: Rays) -> None:
        if camera.intrinsics not in self._directions:
            self._directions[camera.intrinsics] = unit_depth_directions(camera.intrinsics)
        rays[:, :3] = camera.T_world_cam[:3, 3]
        rotation = camera.T_world_cam[:3, :3].astype(np.float32)
        np.matmul(self._directions[camera.intrinsics], rotation.T, out=rays[:, 3:])

    def _shade(self, intrinsics: Intrinsics, rays: Rays, hits: Hits) -> GrayImage:
        """Brightness of every ray, shape (cameras, H * W)."""
        for row, pose in zip(self._bodies[self._meshes.n_fixed :], self._meshes.moving_poses(), strict=True):
            row["rotation"], row["position"] = pose
        bodies = wp.array(self._bodies, dtype=shading_kernels.ShadedBody, device="cpu")
        inputs = [
            (rays.reshape(-1, 6), wp.float32),
            (hits.depth_m.reshape(-1), wp.float32),
            (hits.normal.reshape(-1, 3), wp.vec3),
            (hits.body_index.reshape(-1), wp.int32),
            (self._sunlit(rays, hits).reshape(-1), wp.float32),
        ]
        gray = np.empty(hits.depth_m.size, np.uint8)

        def shade(part: slice) -> None:
            arrays = [warp_view(array[part], dtype) for array, dtype in inputs]
            wp.launch(
                shading_kernels.shade,
                len(gray[part]),
                inputs=[intrinsics.fx_px, self._atmosphere, bodies, *arrays],
                outputs=[warp_view(gray[part], wp.uint8)],
                device="cpu",
            )

        list(self._map(shade, slices(len(gray), self._threads)))
        return gray.reshape(hits.depth_m.shape)

    def _sunlit(self, rays: Rays, hits: Hits) -> FloatImage:
        """1 where the sun reaches a hit, 0 in the shadow of a fixed body; it has the shape of the depths."""
        sunlit = np.ones(hits.depth_m.shape, np.float32)
        if self._casters is not None:
            cameras = list(self._map(self._shadow_rays, rays, hits.depth_m, hits.normal))
            blocked = self._casters.is_blocked(np.concatenate([towards_sun for _, towards_sun in cameras]))
            ends = np.cumsum([len(pixels) for pixels, _ in cameras])
            for lit, (pixels, _), part in zip(sunlit, cameras, np.split(blocked, ends[:-1]), strict=True):
                lit[pixels[part]] = 0
        return sunlit

    def _shadow_rays(self, rays: Rays, depth_m: FloatImage, normal: FloatImage) -> tuple[npt.NDArray[np.intp], Rays]:
        """The pixels of one camera whose surface faces the sun, and rays from these surfaces towards the sun."""
        to_sun = np.array(self._atmosphere.sun, np.float32)
        pixels = np.flatnonzero(np.isfinite(depth_m) & (normal @ to_sun > 0))
        towards_sun = rays[pixels]
        towards_sun[:, :3] += depth_m[pixels, None] * towards_sun[:, 3:] + SHADOW_BIAS_M * to_sun
        towards_sun[:, 3:] = to_sun
        return pixels, towards_sun


def unit_depth_directions(intrinsics: Intrinsics) -> Rays:
    """Ray directions in the camera frame with z = 1, shape (H * W, 3), in raster order."""
    col, row = np.meshgrid(np.arange(intrinsics.width_px), np.arange(intrinsics.height_px))
    x = (col - intrinsics.cx_px) / intrinsics.fx_px
    y = (row - intrinsics.cy_px) / intrinsics.fy_px
    return np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3).astype(np.float32)


def _shaded_bodies(seed: int, surfaces: Sequence[Surface], meshes: SceneMeshes) -> Any:
    """The surfaces and poses of all bodies as an array of `shading_kernels.ShadedBody`."""
    bodies: Any = np.zeros(len(surfaces), shading_kernels.ShadedBody.numpy_dtype())  # type: ignore[attr-defined]
    bodies["seed"] = stream(seed, Purpose.SURFACE, 0).integers(1 << 30, size=len(surfaces))
    for row, surface, body in zip(bodies, surfaces, meshes.body_ids, strict=True):
        row["albedo"], row["texture"] = surface.albedo, surface.texture
        row["pattern"] = shading_kernels.PATTERNS[surface.pattern]
        row["rotation"], row["position"] = meshes.pose(body)
    return bodies
