"""Brightness of the triangles that a camera sees, by their surfaces, the sun and the air."""

import numpy as np

from voxdepth.compiled import compile_all
from voxdepth.types import FloatImage, MaskImage

from ..seeds import Purpose, stream
from ..types import Camera, IdImage, Images
from ..world import World
from . import shading_kernels as kernels
from .meshes import SceneMeshes, normals
from .raycast import Hits


class Shader:
    """Makes images of the first hits of cameras. Threads may share it between two updates.

    What it knows of the triangles and bodies ends with what stands for the sky.
    """

    def __init__(self, world: World, meshes: SceneMeshes) -> None:
        seed, weather, n = world.scene.seed, world.scene.weather, len(meshes.body_ids)
        surfaces = [world.surfaces[body] for body in meshes.body_ids]
        seeds = stream(seed, Purpose.SURFACE, 0).integers(1 << 30, size=n)
        cloud_seed = stream(seed, Purpose.SURFACE, 1).integers(1 << 30)
        patterns = [*(surface.pattern for surface in surfaces), "sky"]
        looks = [*((weather.exposure * surface.albedo, 2 * surface.texture) for surface in surfaces), (0, 1)]
        self._meshes = meshes
        self._weather = weather
        self._id_of_body = np.array([*meshes.body_ids, -1], np.int32)
        self._looks = kernels.Looks(
            normals=np.concatenate([normals(mesh) for mesh in meshes.meshes]).astype(np.float32),
            light=np.empty((len(meshes.body_of_triangle), 2), np.float32),
            body_of_triangle=np.append(meshes.body_of_triangle, np.int32(n)),
            pattern=np.array([kernels.PATTERNS.index(pattern) for pattern in patterns], np.int32),
            seed=np.array([*seeds, cloud_seed], np.uint32),
            surface=np.array(looks, np.float32),
        )
        self._air = kernels.Air(np.float32(weather.haze_m), np.float32(weather.sky), np.float32(weather.clouds))
        self._illuminate(0)
        compile_all()

    def update(self) -> None:
        """Follow the moving bodies to their poses of the last update of the meshes."""
        self._illuminate(self._meshes.n_fixed)

    def black(self, hits: Hits) -> Images:
        """An image without brightness."""
        segment_id = self._id_of_body[self._looks.body_of_triangle[hits.triangle]]
        return Images(gray=np.zeros(hits.depth_m.shape, np.uint8), depth_m=hits.depth_m, segment_id=segment_id)

    def faces_sun(self, triangle: IdImage) -> MaskImage:
        """Whether the sun would shine on triangles, given by their indices, if nothing cast a shadow."""
        return np.append(self._looks.light[:, 1] > 0, False)[triangle]

    def shaded(self, camera: Camera, hits: Hits, sunlit: FloatImage) -> Images:
        """The image of a camera; `sunlit` is 0 in a shadow and 1 elsewhere, shape (H, W)."""
        lens, looks, air = lens_of(camera), self._looks, self._air
        depth_m, triangle, lit = hits.depth_m.reshape(-1), hits.triangle.reshape(-1), sunlit.reshape(-1)
        shape, size = hits.depth_m.shape, len(depth_m)
        spans, places = np.empty((size, 4), np.int32), np.empty(len(looks.pattern) + 2, np.int32)
        points, detail = np.empty((4, size), np.float32), np.zeros(size, np.float32)
        segment_id, gray = np.empty(size, np.int32), np.empty(size, np.uint8)

        bodies = looks.body_of_triangle, self._id_of_body
        n = kernels.find_spans(triangle, lens.width, *bodies, spans, places, segment_id)
        spans = spans[:n]
        kernels.locate(spans, depth_m, lens, looks, self._seen_from(camera), points)
        kernels.locate_clouds(spans, lens, looks, points)
        kernels.draw_windows(spans, points, looks, detail)
        kernels.add_textures(points, places, looks, detail)
        kernels.shade(spans, depth_m, detail, lit, looks, air, gray)
        kernels.shade_sky(spans, detail, lens, looks, air, gray)
        return Images(gray=gray.reshape(shape), depth_m=hits.depth_m, segment_id=segment_id.reshape(shape))

    def _illuminate(self, first: int) -> None:
        """Light on the triangles of the bodies from the first one on, from the sky and from the sun.

        Surfaces that face down receive less ambient light.
        """
        ambient, start = self._weather.ambient, int(np.searchsorted(self._meshes.body_of_triangle, first))
        R_world_body = self._meshes.R_world_body[self._meshes.body_of_triangle[start:]]
        up = np.einsum("ti,ti->t", R_world_body[:, 2], self._looks.normals[start:])
        to_sun = np.einsum("tji,j,ti->t", R_world_body, np.array(self._weather.to_sun), self._looks.normals[start:])
        self._looks.light[start:, 0] = ambient * (0.8 + 0.2 * up)
        self._looks.light[start:, 1] = (1 - ambient) * np.maximum(to_sun, 0)

    def _seen_from(self, camera: Camera) -> FloatImage:
        """Pose of a camera in the frame of each body, shape (bodies, 3, 4)."""
        R_body_world = self._meshes.R_world_body.transpose(0, 2, 1)
        offset_m = camera.T_world_cam[:3, 3] - self._meshes.position_m
        T = np.concatenate([R_body_world @ camera.T_world_cam[:3, :3], R_body_world @ offset_m[:, :, None]], axis=2)
        return T.astype(np.float32)


def lens_of(camera: Camera) -> kernels.Lens:
    """A camera as the loops of shading read it."""
    i = camera.pinhole
    fx, fy, cx, cy = (np.float32(x) for x in (i.fx_px, i.fy_px, i.cx_px, i.cy_px))
    return kernels.Lens(i.width_px, fx, fy, cx, cy, camera.T_world_cam[:3, :3].astype(np.float32))
