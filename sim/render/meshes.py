"""Triangle meshes of what a PyBullet world shows, each in the frame of its body."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pybullet

from voxdepth.types import FloatArray

from .. import frames
from ..bodies import Box, Cylinder, Heightfield, Mesh, Shape, Sphere
from ..errors import RenderError
from ..open3d_import import open3d
from ..solids import origin_height_m
from ..world import World

ROUND_SEGMENTS = 24


def mesh_of_body(world: World, body: int) -> Mesh:
    """All visual shapes of a PyBullet body as one mesh in the frame of the body.

    PyBullet does not give back the vertices of meshes and heightfields that were made in memory: those come from the
    scene. Everything else, bodies loaded from files included, is what PyBullet says that it draws.

    Raises:
        RenderError: The body has no visual shape, or one that is not supported.
    """
    shapes = pybullet.getVisualShapeData(body, physicsClientId=world.client)
    if not shapes:
        raise RenderError(f"body {body} has no visual shape: give it one, or cameras and collisions would disagree")
    if body in world.described:
        described = world.described[body].shape
        if isinstance(described, Mesh | Heightfield):
            return moved(mesh_of_shape(described), np.eye(3), np.array([0, 0, -origin_height_m(described)]))
    return merged([_placed(_mesh_of_visual(shape, body), shape[5], shape[6]) for shape in shapes])


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Several meshes as one, triangles in order."""
    offsets = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.triangles + np.uint32(at) for mesh, at in zip(meshes, offsets, strict=True)]),
    )


def mesh_of_shape(shape: Shape) -> Mesh:
    """A solid of a scene as a mesh in its own frame."""
    return _MADE[type(shape)](shape)


def _mesh_of_visual(shape: Any, body: int) -> Mesh:
    kind, lengths = shape[2], shape[3]
    if kind not in _DRAWN:
        raise RenderError(
            f"body {body} has a visual shape of PyBullet type {kind}; "
            "boxes, cylinders, spheres, and meshes from files or scenes are drawn"
        )
    return _DRAWN[kind](shape, np.array(lengths))


def _mesh_of_file(shape: Any, scale: FloatArray) -> Mesh:
    path = Path(shape[4].decode())
    if not path.is_file():
        raise RenderError(
            f"body {shape[0]} shows the mesh {str(path)!r}, which is not a file: expected the path of an .obj or .stl, "
            "or a body that the scene describes"
        )
    read = open3d().io.read_triangle_mesh(str(path))
    return Mesh(np.asarray(read.vertices) * scale, np.asarray(read.triangles).astype(np.uint32))


_DRAWN: dict[int, Callable[[Any, FloatArray], Mesh]] = {
    pybullet.GEOM_BOX: lambda shape, size_m: box(size_m),
    pybullet.GEOM_CYLINDER: lambda shape, lengths_m: cylinder(radius_m=lengths_m[1], height_m=lengths_m[0]),
    pybullet.GEOM_SPHERE: lambda shape, lengths_m: sphere(lengths_m[0]),
    pybullet.GEOM_MESH: _mesh_of_file,
}


def _placed(mesh: Mesh, position_m: Any, q_xyzw: Any) -> Mesh:
    return moved(mesh, frames.rotation_from_quaternion(np.array(q_xyzw)), np.array(position_m))


def moved(mesh: Mesh, rotation: FloatArray, position_m: FloatArray) -> Mesh:
    """A mesh from its own frame in another."""
    return Mesh(mesh.vertices_m @ rotation.T + position_m, mesh.triangles)


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


def heightfield(field: Heightfield) -> Mesh:
    """Ground of two triangles per grid cell, split as PyBullet splits them."""
    rows, columns = field.height_m.shape
    x = (np.arange(columns) - (columns - 1) / 2) * field.spacing_m
    y = (np.arange(rows) - (rows - 1) / 2) * field.spacing_m
    vertices = np.stack([*np.meshgrid(x, y), field.height_m], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, up, across = corner + 1, corner + columns, corner + columns + 1
    triangles = np.concatenate([np.stack([corner, right, up], 1), np.stack([across, up, right], 1)])
    return Mesh(vertices, triangles.astype(np.uint32))


_MADE: dict[type[Shape], Callable[[Any], Mesh]] = {
    Box: lambda solid: box(np.array(solid.size_m)),
    Cylinder: lambda solid: cylinder(radius_m=solid.radius_m, height_m=solid.height_m),
    Sphere: lambda solid: sphere(solid.radius_m),
    Mesh: lambda solid: solid,
    Heightfield: heightfield,
}
