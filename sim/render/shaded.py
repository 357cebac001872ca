"""Images from the hits of a visibility backend: shading, shadows, depth and segmentation."""

import threading
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from voxdepth.arithmetic import matmul
from voxdepth.compiled import compile_all
from voxdepth.types import FloatImage

from ..cpu import mapper
from ..errors import RenderError
from ..types import Camera, CameraImages
from ..world import World
from .meshes import SceneMeshes
from .mirrors import Mirrors
from .raster import Rasteriser
from .raycast import Hits, RayCaster, RaycastScene, Rays, rays_of
from .shading import Atmosphere, locate, materials_of, projection_of, shade, spans_of
from .textures import add_textures, draw_windows

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
        self._mirrors = Mirrors(world, self._meshes) if backend is Rasteriser else None
        weather = world.scene.weather
        self._ambient, self._to_sun = weather.ambient, np.array(weather.to_sun)
        self._casters = RaycastScene(self._meshes.in_world(self._meshes.fixed), threads) if weather.shadows else None
        self._map = mapper(threads)
        self._thread_local = threading.local()
        self._atmosphere = Atmosphere(np.float32(weather.haze_m), np.float32(weather.sky), np.float32(weather.clouds))
        self._materials = materials_of(world, self._meshes)
        self._id_of_triangle = np.array([*self._meshes.body_ids, -1], np.int32)[self._materials.body_of_triangle]
        self._illuminate(0)
        compile_all()

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[CameraImages]:
        """Return one `CameraImages` per camera of the present state of the world. Without `gray`, these are black.

        Cameras with different intrinsics raise a `RenderError`.
        """
        if not cameras:
            return []
        if any(camera.intrinsics != cameras[0].intrinsics for camera in cameras):
            raise RenderError("all cameras of a batch must have the same intrinsics: render them in separate calls")
        self._meshes.read_poses(self._meshes.moving)
        hits = self._backend.first_hits(cameras)
        if not gray:
            return list(self._map(self._black, cameras, hits))
        self._illuminate(self._meshes.moving.start)
        images = self._shaded(cameras, hits)
        if self._mirrors is not None:
            self._reflect(self._mirrors, cameras, hits, images)
        return images

    def _shaded(self, cameras: Sequence[Camera], hits: Sequence[Hits]) -> list[CameraImages]:
        return list(self._map(self._image, cameras, hits, self._sunlit(cameras, hits)))

    def _reflect(
        self, mirrors: Mirrors, cameras: Sequence[Camera], hits: Sequence[Hits], images: Sequence[CameraImages]
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
        """Return 1 where the sun reaches a hit, 0 in the shadow of a fixed body, for each camera."""
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
        """Return the pixels of one camera whose surface faces the sun, and rays from these surfaces towards the sun."""
        faces_sun = np.append(self._materials.light[:, 1] > 0, False)
        pixels = np.flatnonzero(faces_sun[hits.triangle])
        towards_sun = rays_of(camera)[pixels]
        towards_sun[:, :3] += hits.depth_m.reshape(-1, 1)[pixels] * towards_sun[:, 3:] + SHADOW_BIAS_M * self._to_sun
        towards_sun[:, 3:] = self._to_sun
        return pixels, towards_sun

    def _black(self, camera: Camera, hits: Hits) -> CameraImages:
        """Return an image without brightness."""
        segment_id = self._id_of_triangle.take(hits.triangle)
        gray = np.zeros(hits.depth_m.shape, np.uint8)
        return CameraImages(gray=gray, depth_m=hits.depth_m, segment_id=segment_id, T_world_cam=camera.T_world_cam)

    def _image(self, camera: Camera, hits: Hits, sunlit: FloatImage) -> CameraImages:
        """Return the image of a camera; `sunlit` is 0 in a shadow and 1 elsewhere, shape (H, W)."""
        projection, materials = projection_of(camera), self._materials
        depth_m, lit, size = hits.depth_m.reshape(-1), sunlit.reshape(-1), hits.depth_m.size
        points, detail = self._buffers(size)
        gray = np.empty(size, np.uint8)
        spans, offset_of_body = spans_of(hits.triangle, materials.body_of_triangle)
        locate(spans, depth_m, projection, materials, self._seen_from(camera), points)
        draw_windows(spans, points, materials, detail)
        add_textures(points, offset_of_body, materials, detail)
        shade(spans, depth_m, detail, lit, projection, materials, self._atmosphere, gray)
        segment_id = np.repeat(self._id_of_triangle[spans[:, 2]], spans[:, 1])
        shape, T_world_cam = hits.depth_m.shape, camera.T_world_cam
        return CameraImages(
            gray=gray.reshape(shape),
            depth_m=hits.depth_m,
            segment_id=segment_id.reshape(shape),
            T_world_cam=T_world_cam,
        )

    def _buffers(self, size: int) -> tuple[FloatImage, FloatImage]:
        """Return points and their details, which are 0, for images of a size, in memory that has been used."""
        if len(getattr(self._thread_local, "buffer", ())) < 5 * size:
            self._thread_local.buffer = np.empty(5 * size, np.float32)
        points, detail = np.split(self._thread_local.buffer[: 5 * size], [4 * size])
        detail[:] = 0
        return points.reshape(4, size), detail

    def _illuminate(self, first: int) -> None:
        """Set the light on the triangles of the bodies from the first one on, from the sky and from the sun.

        Surfaces that face down receive less ambient light.
        """
        ambient, start = self._ambient, int(np.searchsorted(self._meshes.body_of_triangle, first))
        R_world_body = self._meshes.R_world_body[self._meshes.body_of_triangle[start:]]
        up = np.einsum("ti,ti->t", R_world_body[:, 2], self._materials.normals[start:])
        to_sun = np.einsum("tji,j,ti->t", R_world_body, self._to_sun, self._materials.normals[start:])
        self._materials.light[start:, 0] = ambient * (0.8 + 0.2 * up)
        self._materials.light[start:, 1] = (1 - ambient) * np.maximum(to_sun, 0)

    def _seen_from(self, camera: Camera) -> FloatImage:
        """Return the pose of a camera in the frame of each body, shape (bodies, 3, 4)."""
        R_body_world = self._meshes.R_world_body.transpose(0, 2, 1)
        offset_m = camera.T_world_cam[:3, 3] - self._meshes.position_m
        T = np.concatenate(
            [
                matmul(R_body_world, camera.T_world_cam[:3, :3]),
                np.einsum("bij,bj->bi", R_body_world, offset_m)[:, :, None],
            ],
            axis=2,
        )
        return T.astype(np.float32)
