"""From what is seen to images: shading, shadows of the sun, depth and labels."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from voxdepth.types import FloatImage, GrayImage, Intrinsics

from ..bodies import Surface
from ..errors import RenderError
from ..memory import on_cpu
from ..parallel import mapper, slices
from ..seeds import Purpose, stream
from ..types import Camera, Images
from ..world import World
from . import shading
from .hits import Hits, Rays, Sight, unit_depth_directions
from .mirror import Mirror
from .raycast import Target

SHADOW_BIAS_M = 0.01
"""Shadow rays start this far above a surface, or it would shade itself."""


class ShadedRenderer:
    """Renders a batch of cameras at once; all must have the same intrinsics.

    Args:
        world: What to show.
        make_sight: Makes, for its meshes and a number of threads, what finds the surface behind each pixel.
        threads: To work with; changes the speed alone.
    """

    def __init__(self, world: World, make_sight: Callable[[Mirror, int], Sight], *, threads: int) -> None:
        self._mirror = mirror = Mirror(world)
        self._sight = make_sight(mirror, threads)
        self._segment_of_index = np.array([*mirror.body_ids, -1], np.int32)
        self._looks = _make_looks(world.scene.seed, [world.surfaces[body] for body in mirror.body_ids], mirror)
        weather = world.scene.weather
        self._air = shading.air(weather, int(stream(world.scene.seed, Purpose.SURFACE, 1).integers(1 << 30)))
        self._casts_shadows = Target(mirror.fixed, np.empty(0, np.int32), 0, threads) if weather.shadows else None
        self._directions: dict[Intrinsics, Rays] = {}
        self._buffer: Rays = np.empty((0, 0, 6), np.float32)
        self._threads = threads
        self._map = mapper(threads)
        wp.load_module(shading, device="cpu")

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now; without `gray` those images are black."""
        if not cameras:
            return []
        intrinsics = cameras[0].intrinsics
        if any(camera.intrinsics != intrinsics for camera in cameras):
            raise RenderError("all cameras of a batch must have the same intrinsics: render them in separate calls")
        rays = self._ray_buffer((len(cameras), intrinsics.width_px * intrinsics.height_px, 6))
        list(self._map(self._fill_rays, cameras, rays))
        hits = self._sight.look(cameras, rays)
        lit = self._shade(intrinsics, rays, hits) if gray else np.zeros(rays.shape[:2], np.uint8)
        return [
            Images(
                gray=lit[i].reshape(intrinsics.shape).copy(),  # of their own, not views of the whole batch
                depth_m=hits.depth_m[i].reshape(intrinsics.shape).copy(),
                segment_id=self._segment_of_index[hits.body_index[i]].reshape(intrinsics.shape),
            )
            for i in range(len(cameras))
        ]

    def _ray_buffer(self, shape: tuple[int, int, int]) -> Rays:
        """Memory for the rays of a batch, kept between batches of one size."""
        if self._buffer.shape != shape:
            self._buffer = np.empty(shape, np.float32)
        return self._buffer

    def _fill_rays(self, camera: Camera, rays: Rays) -> None:
        """Write the rays of a camera into an array of shape (H * W, 6)."""
        if camera.intrinsics not in self._directions:
            self._directions[camera.intrinsics] = unit_depth_directions(camera.intrinsics)
        rays[:, :3] = camera.T_world_cam[:3, 3]
        rotation = camera.T_world_cam[:3, :3].astype(np.float32)
        np.matmul(self._directions[camera.intrinsics], rotation.T, out=rays[:, 3:])

    def _looks_now(self) -> Any:
        """How every body looks and where it is, as a Warp array."""
        moving = self._looks[self._mirror.n_fixed :]
        for look, (rotation, position_m) in zip(moving, self._mirror.moving_poses(), strict=True):
            look["rotation"], look["position"] = rotation, position_m
        return wp.array(self._looks, dtype=shading.BodyLook, device="cpu")

    def _sunlit(self, rays: Rays, hits: Hits) -> FloatImage:
        """1 where the sun reaches what was hit, 0 in the shadow of a fixed body; shape like the depths."""
        sunlit = np.ones(hits.depth_m.shape, np.float32)
        if self._casts_shadows is not None:
            cameras = list(self._map(self._shadow_rays, rays, hits.depth_m, hits.normal))
            blocked = self._casts_shadows.blocked(np.concatenate([towards_sun for _, towards_sun in cameras]))
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

    def _shade(self, intrinsics: Intrinsics, rays: Rays, hits: Hits) -> GrayImage:
        """Brightness of every ray, shape (cameras, H * W)."""
        inputs = [
            (rays.reshape(-1, 6), wp.float32),
            (hits.depth_m.reshape(-1), wp.float32),
            (hits.normal.reshape(-1, 3), wp.vec3),
            (hits.body_index.reshape(-1), wp.int32),
            (self._sunlit(rays, hits).reshape(-1), wp.float32),
        ]
        looks = self._looks_now()
        gray = np.empty(hits.depth_m.size, np.uint8)

        def shade(part: slice) -> None:
            arrays = [on_cpu(array[part], kind) for array, kind in inputs]
            wp.launch(
                shading.shade,
                len(gray[part]),
                inputs=[intrinsics.fx_px, self._air, looks, *arrays],
                outputs=[on_cpu(gray[part], wp.uint8)],
                device="cpu",
            )

        list(self._map(shade, slices(len(gray), self._threads)))
        return gray.reshape(hits.depth_m.shape)


def _make_looks(seed: int, surfaces: Sequence[Surface], mirror: Mirror) -> Any:
    looks = np.zeros(len(surfaces), shading.BodyLook.numpy_dtype())  # type: ignore[attr-defined]
    seeds = stream(seed, Purpose.SURFACE, 0).integers(1 << 30, size=len(surfaces))
    for i, (surface, body) in enumerate(zip(surfaces, mirror.body_ids, strict=True)):
        looks[i]["albedo"] = surface.albedo
        looks[i]["texture"] = surface.texture
        looks[i]["pattern"] = shading.PATTERNS[surface.pattern]
        looks[i]["seed"] = seeds[i]
        looks[i]["rotation"], looks[i]["position"] = mirror.pose(body)
    return looks
