"""Panes that reflect: what a mirror shows is what a camera sees from the other side of it, at its mirror image.

The mirror images of both cameras of a pair see the reflected things with the disparity of their mirror images, which
are as far behind the pane as the things are in front of it. So a stereo camera measures a depth beyond the pane.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from voxdepth.arithmetic import matmul
from voxdepth.types import FloatArray, GrayImage, MaskImage

from ..bodies import Mesh
from ..types import Camera, Pinhole
from ..world import World
from .meshes import SceneMeshes, normals
from .raycast import Hits

UPRIGHT = 0.1
"""Planes are upright whose normal rises less than this."""
BIAS_M = 1e-3
"""Distance of the nearest thing that a pane reflects, so that it does not reflect itself."""
FRAME_M = 0.06
"""Width of the frames between panes."""
PLANE_DECIMALS = 6
"""Decimals by which triangles are in one plane."""


class Pane(NamedTuple):
    """The part of an image that shows a plane surface which reflects."""

    camera: Camera
    """The mirror image of the camera, which sees what the pane reflects in the window of the pane."""
    window: tuple[slice, slice]
    """Rows and columns of the image."""
    mask: MaskImage
    """Pixels of the window that show the pane."""
    reflectivity: float

    def show(self, reflection: GrayImage, gray: GrayImage) -> None:
        """Add the reflection, an image of the window, to the gray image of the whole camera, in place."""
        part = gray[self.window]
        mixed = (1 - self.reflectivity) * part[self.mask] + self.reflectivity * reflection[self.mask]
        part[self.mask] = np.rint(mixed).astype(np.uint8)


class Mirrors:
    """The reflecting surfaces of a world."""

    def __init__(self, world: World, meshes: SceneMeshes) -> None:
        self._meshes = meshes
        surfaces = world.surfaces
        self._pane_m = [surfaces[body_id].pane_m for body_id in meshes.body_ids]
        self._planes: list[tuple[int, FloatArray, float]] = []
        """Index of a body, a plane (a, b, c, d) in its frame, and its reflectivity."""
        self._plane_of_triangle = np.full(len(meshes.body_of_triangle) + 1, -1, np.int32)
        for body, body_id in enumerate(meshes.body_ids):
            if reflectivity := surfaces[body_id].reflectivity:
                planes, which = np.unique(planes_of(meshes.meshes[body]), axis=0, return_inverse=True)
                self._plane_of_triangle[np.flatnonzero(meshes.body_of_triangle == body)] = len(self._planes) + which
                self._planes += [(body, plane, reflectivity) for plane in planes]

    def panes(self, camera: Camera, hits: Hits) -> Iterator[Pane]:
        """Yield the panes that a camera sees, in the order of the bodies."""
        if not self._planes:
            return
        plane_of_pixel = self._plane_of_triangle[hits.triangle]
        for index in np.unique(plane_of_pixel[plane_of_pixel >= 0]).tolist():
            body, plane, reflectivity = self._planes[index]
            normal = matmul(self._meshes.R_world_body[body], plane[:3])
            offset_m = float(plane[3] - matmul(normal, self._meshes.position_m[body]))
            if matmul(normal, camera.T_world_cam[:3, 3]) + offset_m <= 0:  # The camera is inside of the body.
                continue
            mask = plane_of_pixel == index
            if self._pane_m[body] and abs(plane[2]) < UPRIGHT:
                self._leave_frames(mask, body, plane[:3], camera, hits)
            if not mask.any():
                continue
            rows, cols = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
            top, left, bottom, right = int(rows[0]), int(cols[0]), int(rows[-1]) + 1, int(cols[-1]) + 1
            i, window = camera.intrinsics, (slice(top, bottom), slice(left, right))
            # The camera behind the mirror, of the window alone. It sees nothing between itself and the plane.
            virtual = Camera(
                T_world_cam=matmul(mirrored(normal, offset_m), camera.T_world_cam),
                intrinsics=Pinhole(i.fx_px, i.fy_px, i.cx_px - left, i.cy_px - top, right - left, bottom - top),
                clip_plane=np.append(normal, offset_m - BIAS_M),
            )
            yield Pane(virtual, window, mask[window], reflectivity)

    def _leave_frames(self, mask: MaskImage, body: int, normal: FloatArray, camera: Camera, hits: Hits) -> None:
        """Take the pixels out of a mask, in place, that show the frames around the panes of an upright plane."""
        rows, cols = np.nonzero(mask)
        eye, depth_m = camera.intrinsics, hits.depth_m[rows, cols]
        rays = np.column_stack([(cols - eye.cx_px) / eye.fx_px, (rows - eye.cy_px) / eye.fy_px, np.ones(len(rows))])
        in_world = matmul(depth_m[:, None] * rays, camera.T_world_cam[:3, :3].T) + camera.T_world_cam[:3, 3]
        in_body = matmul(in_world - self._meshes.position_m[body], self._meshes.R_world_body[body])
        along = matmul(in_body, np.array([-normal[1], normal[0], 0.0]))
        is_frame = (np.column_stack([along, in_body[:, 2]]) % self._pane_m[body] < FRAME_M).any(axis=1)
        mask[rows[is_frame], cols[is_frame]] = False


def mirrored(normal: FloatArray, offset_m: float) -> FloatArray:
    """Return the reflection at the plane `normal . p + offset = 0`, shape (4, 4); the normal has the length 1."""
    reflection = np.eye(4)
    reflection[:3, :3] -= 2 * np.outer(normal, normal)
    reflection[:3, 3] = -2 * offset_m * normal
    return reflection


def planes_of(mesh: Mesh) -> FloatArray:
    """Return the plane `a x + b y + c z + d = 0` of each triangle, shape (T, 4), rounded to make equals alike."""
    normal = normals(mesh)
    offset_m = -(normal * mesh.vertices_m[mesh.triangles[:, 0]]).sum(axis=1)
    return np.column_stack([normal, offset_m]).round(PLANE_DECIMALS) + 0.0  # Which makes 0 of -0.
