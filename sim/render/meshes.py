"""Triangle meshes of PyBullet's visual shapes, in their own frames."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pybullet

from voxdepth.types import FloatArray

from .. import frames
from ..errors import RenderError

ROUND_SEGMENTS = 24


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices [m], shape (V, 3), and triangles as vertex indices, shape (T, 3)."""

    vertices_m: FloatArray
    triangles: npt.NDArray[np.uint32]


def mesh_of_body(body: int, client: int) -> Mesh:
    """All visual shapes of a PyBullet body as one mesh in the frame of the body.

    Raises:
        RenderError: The body has no visual shape, or one that is not supported.
    """
    shapes = pybullet.getVisualShapeData(body, physicsClientId=client)
    if not shapes:
        raise RenderError(f"body {body} has no visual shape: give it one, or cameras and collisions would disagree")
    parts = [_placed(_mesh_of_shape(shape, body), shape[5], shape[6]) for shape in shapes]
    return merged(parts)


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one, triangles in order."""
    offsets = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.triangles + np.uint32(at) for mesh, at in zip(meshes, offsets, strict=True)]),
    )


def _mesh_of_shape(shape: Any, body: int) -> Mesh:
    kind, lengths = shape[2], shape[3]
    if kind == pybullet.GEOM_BOX:
        return box(np.array(lengths))
    if kind == pybullet.GEOM_CYLINDER:
        return cylinder(radius_m=lengths[1], height_m=lengths[0])
    if kind == pybullet.GEOM_SPHERE:
        return sphere(lengths[0])
    raise RenderError(f"body {body} has a visual shape of PyBullet type {kind}; boxes, cylinders and spheres are drawn")


def _placed(mesh: Mesh, position_m: Any, q_xyzw: Any) -> Mesh:
    rotation = frames.rotation_from_quaternion(np.array(q_xyzw))
    return Mesh(mesh.vertices_m @ rotation.T + np.array(position_m), mesh.triangles)


def box(size_m: FloatArray) -> Mesh:
    """A box with the origin at its centre."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corners * size_m, np.array(triangles, np.uint32))


def cylinder(*, radius_m: float, height_m: float) -> Mesh:
    """A closed cylinder along z with the origin at its centre."""
    angle = np.arange(ROUND_SEGMENTS) * 2 * np.pi / ROUND_SEGMENTS
    ring = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(ROUND_SEGMENTS, -height_m / 2)])
    high = np.column_stack([ring, np.full(ROUND_SEGMENTS, height_m / 2)])
    caps = np.array([[0, 0, -height_m / 2], [0, 0, height_m / 2]])
    n = ROUND_SEGMENTS
    triangles = []
    for i in range(n):
        j = (i + 1) % n
        triangles += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return Mesh(np.concatenate([low, high, caps]), np.array(triangles, np.uint32))


def sphere(radius_m: float) -> Mesh:
    """A sphere of rings and segments with the origin at its centre."""
    rings = ROUND_SEGMENTS // 2
    polar, around = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.arange(ROUND_SEGMENTS) * 2 * np.pi / ROUND_SEGMENTS, indexing="ij"
    )
    vertices = radius_m * np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    n = ROUND_SEGMENTS
    triangles = []
    for ring in range(rings):
        for i in range(n):
            a, b = ring * n + i, ring * n + (i + 1) % n
            triangles += [(a, a + n, b + n), (a, b + n, b)]
    return Mesh(vertices, np.array(triangles, np.uint32))
