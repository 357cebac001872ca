"""Images from the hits of a visibility backend: shading, shadows, depth and segmentation."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatImage

from ..cpu import mapper
from ..errors import RenderError
from ..types import Camera, Images
from ..world import World
from .meshes import SceneMeshes
from .mirrors import Mirrors
from .raster import Rasteriser
from .raycast import Hits, RayCaster, RaycastScene, Rays, rays_of
from .shading import Shader

SHADOW_BIAS_M = 0.01
"""Distance above a surface at which shadow rays start, so that the surface does not shade itself."""


class ShadedRenderer:
    """Renders a batch of cameras with the same intrinsics. The number of threads changes only the speed.

    Other threads may compute meanwhile: the loops over pixels run without Python's lock, and images that were returned
    never change. But only one thread may call `render` at a time, and the world must not step during the call.
    """

    def __init__(self, world: World, backend: type[Rasteriser] | type[RayCaster], *, threads: int) -> None:
        self._meshes = SceneMeshes(world)
        self._backend = backend(self._meshes, threads)
        self._shader = Shader(world, self._meshes)
        self._mirrors = Mirrors(world, self._meshes) if backend is Rasteriser else None
        self._to_sun = np.array(world.scene.weather.to_sun)
        shadows = world.scene.weather.shadows
        self._casters = RaycastScene(self._meshes.fixed_in_world(), threads) if shadows else None
        self._map = mapper(threads)

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera of the present state of the world. Without `gray`, the gray images are black.

        Cameras with different intrinsics raise a `RenderError`.
        """
        if not cameras:
            return []
        if any(camera.intrinsics != cameras[0].intrinsics for camera in cameras):
            raise RenderError("all cameras of a batch must have the same intrinsics: render them in separate calls")
        self._meshes.update()
        hits = self._backend.first_hits(cameras)
        if not gray:
            return list(self._map(self._shader.black, cameras, hits))
        self._shader.update()
        images = self._shaded(cameras, hits)
        if self._mirrors is not None:
            self._reflect(self._mirrors, cameras, hits, images)
        return images

    def _shaded(self, cameras: Sequence[Camera], hits: Sequence[Hits]) -> list[Images]:
        return list(self._map(self._shader.shaded, cameras, hits, self._sunlit(cameras, hits)))

    def _reflect(
        self, mirrors: Mirrors, cameras: Sequence[Camera], hits: Sequence[Hits], images: Sequence[Images]
    ) -> None:
        """Add what the panes in the images reflect, in place. Panes that a reflection shows reflect nothing."""
        seen = [(pane, image) for camera, hit, image in zip(cameras, hits, images, strict=True)
                for pane in mirrors.panes(camera, hit)]  # fmt: skip
        if seen:
            virtual = [pane.camera for pane, _ in seen]
            reflections = self._shaded(virtual, self._backend.first_hits(virtual))
            for (pane, image), reflection in zip(seen, reflections, strict=True):
                pane.show(reflection.gray, image.gray)

    def _sunlit(self, cameras: Sequence[Camera], hits: Sequence[Hits]) -> list[FloatImage]:
        """1 where the sun reaches a hit, 0 in the shadow of a fixed body, for each camera."""
        if self._casters is None:
            lit: FloatImage = np.ones(max(hit.depth_m.size for hit in hits), np.float32)
            return [lit[: hit.depth_m.size].reshape(hit.depth_m.shape) for hit in hits]
        starts = list(self._map(self._shadow_rays, cameras, hits))
        blocked = self._casters.is_blocked(np.concatenate([towards_sun for _, towards_sun in starts]))
        ends = np.cumsum([len(pixels) for pixels, _ in starts])
        sunlit = [np.ones(hit.depth_m.shape, np.float32) for hit in hits]
        for lit, (pixels, _), part in zip(sunlit, starts, np.split(blocked, ends[:-1]), strict=True):
            lit.reshape(-1)[pixels[part]] = 0
        return sunlit

    def _shadow_rays(self, camera: Camera, hits: Hits) -> tuple[npt.NDArray[np.intp], Rays]:
        """The pixels of one camera whose surface faces the sun, and rays from these surfaces towards the sun."""
        pixels = np.flatnonzero(self._shader.faces_sun(hits.triangle))
        towards_sun = rays_of(camera)[pixels]
        towards_sun[:, :3] += hits.depth_m.reshape(-1, 1)[pixels] * towards_sun[:, 3:] + SHADOW_BIAS_M * self._to_sun
        towards_sun[:, 3:] = self._to_sun
        return pixels, towards_sun
