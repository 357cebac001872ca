"""PyBullet shapes of the solids that a scene is made of."""

from collections.abc import Callable
from typing import Any

import pybullet

from .bodies import Box, Cylinder, Heightfield, Mesh, Shape, Sphere, Surface

NO_SHAPE = -1


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
    return pybullet.GEOM_MESH, collision, {"vertices": vertices, "indices": indices, "normals": vertices}


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
