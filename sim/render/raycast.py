"""Ray casting by Embree through Open3D."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from voxdepth.types import FloatArray

from ..bodies import Mesh
from ..open3d_import import open3d
from ..types import Camera, IdImage
from .culling import pixel_bounds
from .hits import Hits, Rays
from .meshes import merged
from .mirror import Mirror


class RayCaster:
    """Finds what cameras see by casting a ray through every pixel.

    Fixed bodies form one target that is built once. What moves forms a second one, rebuilt for every batch, at which
    only the rays near each of them are cast.
    """

    def __init__(self, mirror: Mirror, threads: int) -> None:
        self._mirror = mirror
        self._threads = threads
        self._radii_m = np.array([np.linalg.norm(mesh.vertices_m, axis=1).max() for mesh in mirror.moving])
        n_fixed = sum(len(mesh.triangles) for mesh in mirror.fixed)
        self._fixed = Target(mirror.fixed, mirror.body_of_triangle[:n_fixed], len(mirror.body_ids), threads)
        self._moving_index = mirror.body_of_triangle[n_fixed:]

    def look(self, cameras: Sequence[Camera], rays: Rays) -> Hits:
        """The first hit of each ray, shape (cameras, H * W)."""
        hits = self._fixed.cast(rays)
        if self._mirror.moving:
            self._add_moving(cameras, rays, hits)
        return hits

    def _add_moving(self, cameras: Sequence[Camera], rays: Rays, hits: Hits) -> None:
        """Overwrite hits where what moves is nearer; only pixels that its bounding sphere may cover are looked at."""
        centers_m = np.array([position_m for _, position_m in self._mirror.moving_poses()])
        pixels = _pixels_near(cameras, centers_m, self._radii_m)
        if len(pixels) == 0:
            return
        target = Target(self._mirror.moving_now(), self._moving_index, len(self._mirror.body_ids), self._threads)
        flat = Hits(hits.depth_m.reshape(-1), hits.normal.reshape(-1, 3), hits.body_index.reshape(-1))
        near = target.cast(rays.reshape(-1, 6)[pixels])
        nearer = near.depth_m < flat.depth_m[pixels]
        for everywhere, of_moving in zip(flat, near, strict=True):
            everywhere[pixels[nearer]] = of_moving[nearer]


class Target:
    """Meshes to cast rays at.

    Args:
        meshes: In the world.
        body_of_triangle: What a hit at each of their triangles is reported as.
        nothing: What a ray that hits none is reported as.
        threads: To cast with.
    """

    def __init__(self, meshes: Sequence[Mesh], body_of_triangle: IdImage, nothing: int, threads: int) -> None:
        self._o3d = open3d()
        self._threads = threads
        self._scene = self._o3d.t.geometry.RaycastingScene()
        self._index = np.append(body_of_triangle, np.int32(nothing))
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


def _pixels_near(cameras: Sequence[Camera], centers_m: FloatArray, radii_m: FloatArray) -> npt.NDArray[np.intp]:
    """Indices into all pixels of a batch that spheres may cover; pixels that two spheres share come twice."""
    height, width = cameras[0].intrinsics.shape
    parts = [np.empty(0, np.intp)]
    for camera, top, bottom, left, right in pixel_bounds(cameras, centers_m, radii_m).tolist():
        rows = (camera * height + np.arange(top, bottom)) * width
        parts.append((rows[:, None] + np.arange(left, right)).ravel())
    return np.concatenate(parts)
