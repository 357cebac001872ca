"""Triangle meshes of the visible bodies of a world."""

from collections.abc import Sequence

import numpy as np

from voxdepth.arithmetic import cos, matmul, sin
from voxdepth.types import FloatArray, MaskImage

from .. import frames
from ..bodies import Box, Cylinder, Heightfield, Mesh, Shape, Sphere
from ..engine import pybullet
from ..solids import origin_height_m
from ..types import IdImage
from ..world import World

ROUND_SEGMENTS = 24


class SceneMeshes:
    """Meshes and poses of all bodies of a world: first the fixed bodies, then drones and movers."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.body_ids = [*world.bodies, *world.drone_ids, *world.movers]
        self.fixed, self.moving = range(len(world.bodies)), range(len(world.bodies), len(self.body_ids))
        """Indices into `body_ids`, and into all that is listed by body here."""
        shapes = [world.described[body].shape for body in self.body_ids]
        self.meshes = [moved(mesh_of_shape(one), np.eye(3), np.array([0, 0, -origin_height_m(one)])) for one in shapes]
        """Each in PyBullet's frame of its body."""
        self.is_closed: MaskImage = np.array(
            [
                isinstance(shape, Box | Cylinder | Sphere) or mesh.is_closed
                for shape, mesh in zip(shapes, self.meshes, strict=True)
            ],
            np.bool_,
        )
        """Which of them are closed surfaces, as all solids are, shape (B,)."""
        self.body_of_triangle: IdImage = np.repeat(
            np.arange(len(self.meshes), dtype=np.int32), [len(mesh.triangles) for mesh in self.meshes]
        )
        """Index into `body_ids`, shape (T,), for the triangles of all meshes."""
        self.R_world_body: FloatArray = np.empty((len(self.meshes), 3, 3))
        """Rotations of all bodies when their poses were read."""
        self.position_m: FloatArray = np.empty((len(self.meshes), 3))
        """Positions of all bodies in the world frame when their poses were read [m]."""
        self.read_poses(range(len(self.body_ids)))

    def read_poses(self, bodies: range) -> None:
        """Read the present poses of some bodies from the world."""
        for i in bodies:
            pose = pybullet.getBasePositionAndOrientation(self.body_ids[i], physicsClientId=self._world.client)
            self.position_m[i] = pose[0]
            self.R_world_body[i] = frames.rotation_from_quaternion(np.array(pose[1]))

    def in_world(self, bodies: range) -> list[Mesh]:
        """Return meshes of some bodies in the world frame, at the poses that were read."""
        return [moved(self.meshes[i], self.R_world_body[i], self.position_m[i]) for i in bodies]


def merged(meshes: Sequence[Mesh]) -> Mesh:
    """Return several meshes as one; the triangles keep their order."""
    offsets = np.cumsum([0, *(len(mesh.vertices_m) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices_m for mesh in meshes]),
        np.concatenate([mesh.triangles + np.uint32(at) for mesh, at in zip(meshes, offsets, strict=True)]),
    )


def moved(mesh: Mesh, rotation: FloatArray, position_m: FloatArray) -> Mesh:
    """Return a mesh after a rigid transformation."""
    return Mesh(matmul(mesh.vertices_m, rotation.T) + position_m, mesh.triangles)


def normals(mesh: Mesh) -> FloatArray:
    """Return the unit normals of the triangles, shape (T, 3); 0 for a triangle without area."""
    a, b, c = np.moveaxis(mesh.vertices_m[mesh.triangles], 1, 0)
    normal = np.cross(b - a, c - a)
    return np.asarray(normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(np.float64).tiny))


def bounding_sphere(mesh: Mesh) -> FloatArray:
    """Return the centre and radius [m], shape (4,)."""
    center_m = (mesh.vertices_m.min(axis=0) + mesh.vertices_m.max(axis=0)) / 2
    return np.append(center_m, np.sqrt(((mesh.vertices_m - center_m) ** 2).sum(axis=1).max()))


def mesh_of_shape(shape: Shape) -> Mesh:
    """Return a shape of a scene as a mesh in its own frame."""
    match shape:
        case Box(size_m):
            return box(np.array(size_m))
        case Cylinder(radius_m, height_m):
            return cylinder(radius_m=radius_m, height_m=height_m)
        case Sphere(radius_m):
            return sphere(radius_m)
        case Heightfield():
            return heightfield(shape)
    return shape


def box(size_m: FloatArray) -> Mesh:
    """Return a box with the origin at its centre."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    return Mesh(corners * size_m, np.array(triangles, np.uint32))


def cylinder(*, radius_m: float, height_m: float) -> Mesh:
    """Return a closed cylinder along z with the origin at its centre."""
    n = ROUND_SEGMENTS
    angle = np.arange(n) * 2 * np.pi / n
    ring = np.stack([radius_m * cos(angle), radius_m * sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(n, -height_m / 2)])
    high = np.column_stack([ring, np.full(n, height_m / 2)])
    caps = np.array([[0, 0, -height_m / 2], [0, 0, height_m / 2]])
    triangles = []
    for i in range(n):
        j = (i + 1) % n
        triangles += [(i, j, n + j), (i, n + j, n + i), (2 * n, j, i), (2 * n + 1, n + i, n + j)]
    return Mesh(np.concatenate([low, high, caps]), np.array(triangles, np.uint32))


def sphere(radius_m: float) -> Mesh:
    """Return a sphere of rings and segments with the origin at its centre."""
    n, rings = ROUND_SEGMENTS, ROUND_SEGMENTS // 2
    polar, around = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(n) * 2 * np.pi / n, indexing="ij")
    unit = np.stack([sin(polar) * cos(around), sin(polar) * sin(around), cos(polar)], axis=-1)
    vertices = radius_m * unit.reshape(-1, 3)
    triangles = []
    for ring in range(rings):
        for i in range(n):
            a, b = ring * n + i, ring * n + (i + 1) % n
            triangles += [(a, a + n, b + n), (a, b + n, b)]
    return Mesh(vertices, np.array(triangles, np.uint32))


def heightfield(field: Heightfield) -> Mesh:
    """Return ground with two triangles per grid cell, which is split along the same diagonal as in PyBullet."""
    rows, columns = field.height_m.shape
    x = (np.arange(columns) - (columns - 1) / 2) * field.spacing_m
    y = (np.arange(rows) - (rows - 1) / 2) * field.spacing_m
    vertices = np.stack([*np.meshgrid(x, y), field.height_m], axis=-1).reshape(-1, 3)
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    right, up, across = corner + 1, corner + columns, corner + columns + 1
    triangles = np.concatenate([np.stack([corner, right, up], 1), np.stack([across, up, right], 1)])
    return Mesh(vertices, triangles.astype(np.uint32))
