"""PyBullet bodies of the solids that a scene is made of."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pybullet

from voxdepth.types import FloatArray

from . import frames
from .bodies import Body, Box, Cylinder, Heightfield, Mesh, Shape, Sphere, Surface
from .seeds import Purpose, stream

NO_SHAPE = -1


def create_body(body: Body, client: int) -> int:
    """Place a static body in a PyBullet client and return its id there."""
    collision, visual = create_shapes(body.shape, body.surface, client)
    x, y, z = body.position_m
    q_world_body_xyzw = frames.quaternion_from_yaw(body.yaw_rad).tolist()
    position = [x, y, z + origin_height_m(body.shape)]
    return int(pybullet.createMultiBody(0, collision, visual, position, q_world_body_xyzw, physicsClientId=client))


def apply_texture(bodies: Sequence[int], seed: int, client: int) -> None:
    """One seeded noise texture on some bodies, for PyBullet's renderers: they know neither strength nor pattern."""
    noise = stream(seed, Purpose.SURFACE).integers(90, 256, (256, 256), dtype=np.uint8)
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "noise.png")
        cv2.imwrite(path, cv2.cvtColor(cv2.GaussianBlur(noise, (0, 0), 1.0), cv2.COLOR_GRAY2BGR))
        texture = pybullet.loadTexture(path, physicsClientId=client)
    for body in bodies:
        pybullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=client)


def create_shapes(shape: Shape, surface: Surface, client: int) -> tuple[int, int]:
    """Collision and visual shape ids of a solid; a heightfield is drawn by its collision shape."""
    kind, collision, visual = _DESCRIPTIONS[type(shape)](shape)
    collision_id = pybullet.createCollisionShape(kind, **collision, physicsClientId=client)
    if visual is None:
        return collision_id, NO_SHAPE
    albedo = surface.albedo
    visual_id = pybullet.createVisualShape(
        kind, **visual, rgbaColor=[albedo, albedo, albedo, 1], specularColor=[0, 0, 0], physicsClientId=client
    )
    return collision_id, visual_id


def origin_height_m(shape: Shape) -> float:
    """Height of PyBullet's origin of a shape above the shape's own: it centres heightfields between their extremes."""
    if isinstance(shape, Heightfield):
        return float(shape.height_m.min() + shape.height_m.max()) / 2
    return 0.0


Description = tuple[int, dict[str, Any], dict[str, Any] | None]
"""PyBullet's kind of a shape, and what creates its collision and its visual shape."""


def _box(box: Box) -> Description:
    size = {"halfExtents": [side / 2 for side in box.size_m]}
    return pybullet.GEOM_BOX, size, size


def _cylinder(cylinder: Cylinder) -> Description:
    radius, height = cylinder.radius_m, cylinder.height_m
    return pybullet.GEOM_CYLINDER, {"radius": radius, "height": height}, {"radius": radius, "length": height}


def _sphere(sphere: Sphere) -> Description:
    return pybullet.GEOM_SPHERE, {"radius": sphere.radius_m}, {"radius": sphere.radius_m}


def _mesh(mesh: Mesh) -> Description:
    vertices, indices = mesh.vertices_m.tolist(), mesh.triangles.ravel().tolist()
    collision = {"vertices": vertices, "indices": indices, "flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH}
    return pybullet.GEOM_MESH, collision, {"vertices": vertices, "indices": indices, "normals": _normals(mesh).tolist()}


def _normals(mesh: Mesh) -> FloatArray:
    """Unit normal of each vertex, shape (V, 3): that of its triangles together."""
    a, b, c = np.moveaxis(mesh.vertices_m[mesh.triangles], 1, 0)
    total = np.zeros_like(mesh.vertices_m, np.float64)
    np.add.at(total, mesh.triangles, np.cross(b - a, c - a)[:, None])
    normals: FloatArray = total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    return normals


def _heightfield(field: Heightfield) -> Description:
    rows, columns = field.height_m.shape
    collision = {
        "meshScale": [field.spacing_m, field.spacing_m, 1.0],
        "heightfieldTextureScaling": columns,
        "heightfieldData": field.height_m.ravel().tolist(),
        "numHeightfieldRows": columns,
        "numHeightfieldColumns": rows,
    }
    return pybullet.GEOM_HEIGHTFIELD, collision, None


_DESCRIPTIONS: dict[type[Shape], Callable[[Any], Description]] = {
    Box: _box,
    Cylinder: _cylinder,
    Sphere: _sphere,
    Mesh: _mesh,
    Heightfield: _heightfield,
}
