"""Creates the bodies of a scene in PyBullet."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from voxdepth.types import FloatArray

from . import frames
from .bodies import Body, Box, Cylinder, Heightfield, Mesh, Shape, Sphere, Surface
from .engine import pybullet
from .errors import SimError
from .seeds import Purpose, stream


def create_body(body: Body, client: int) -> int:
    """Create a static body in a PyBullet client and return its id."""
    collision, visual = create_shapes(body.shape, body.surface, client)
    x, y, z = body.position_m
    q_world_body_xyzw = frames.quaternion_from_yaw(body.yaw_rad).tolist()
    position = [x, y, z + origin_height_m(body.shape)]
    return int(pybullet.createMultiBody(0, collision, visual, position, q_world_body_xyzw, physicsClientId=client))


def apply_texture(bodies: Mapping[int, Body], seed: int, client: int) -> None:
    """Give the textured ones of some bodies a noise texture for PyBullet's renderers, which ignore its strength."""
    noise = stream(seed, Purpose.SURFACE).integers(90, 256, (256, 256), dtype=np.uint8)
    _, png = cv2.imencode(".png", cv2.cvtColor(cv2.GaussianBlur(noise, (0, 0), 1.0), cv2.COLOR_GRAY2BGR))
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "noise.png"
            path.write_bytes(png.tobytes())
            texture = pybullet.loadTexture(str(path), physicsClientId=client)
    except OSError as error:
        raise SimError(f"cannot write a texture for PyBullet: {error}; TMPDIR may name a folder with space") from error
    for body in (body for body, own in bodies.items() if own.surface.texture > 0):
        pybullet.changeVisualShape(body, -1, textureUniqueId=texture, physicsClientId=client)


def create_shapes(shape: Shape, surface: Surface, client: int) -> tuple[int, int]:
    """Return the collision and visual shape ids of a shape; PyBullet draws a heightfield by its collision shape."""
    kind, collision, visual = _describe(shape)
    collision_id = pybullet.createCollisionShape(kind, **collision, physicsClientId=client)
    if visual is None:
        return collision_id, -1
    albedo = surface.albedo
    visual_id = pybullet.createVisualShape(
        kind, **visual, rgbaColor=[albedo, albedo, albedo, 1], specularColor=[0, 0, 0], physicsClientId=client
    )
    return collision_id, visual_id


def origin_height_m(shape: Shape) -> float:
    """Return the height of PyBullet's origin above that of a shape; a heightfield is centred between its extremes."""
    if isinstance(shape, Heightfield):
        return float(shape.height_m.min() + shape.height_m.max()) / 2
    return 0.0


def _describe(shape: Shape) -> tuple[int, dict[str, Any], dict[str, Any] | None]:
    """Return PyBullet's type of a shape, and the arguments for its collision shape and its visual shape."""
    match shape:
        case Box(size_m):
            size = {"halfExtents": [side / 2 for side in size_m]}
            return pybullet.GEOM_BOX, size, size
        case Cylinder(radius, height):
            return pybullet.GEOM_CYLINDER, {"radius": radius, "height": height}, {"radius": radius, "length": height}
        case Sphere(radius):
            return pybullet.GEOM_SPHERE, {"radius": radius}, {"radius": radius}
        case Mesh(vertices_m, triangles):
            mesh = {"vertices": vertices_m.tolist(), "indices": triangles.ravel().tolist()}
            collision = {**mesh, "flags": pybullet.GEOM_FORCE_CONCAVE_TRIMESH}
            return pybullet.GEOM_MESH, collision, {**mesh, "normals": _vertex_normals(shape).tolist()}
        case Heightfield(height_m, spacing_m):
            rows, columns = height_m.shape
            collision = {
                "meshScale": [spacing_m, spacing_m, 1.0],
                "heightfieldTextureScaling": columns,
                "heightfieldData": height_m.ravel().tolist(),
                "numHeightfieldRows": columns,  # The number of heights along x.
                "numHeightfieldColumns": rows,
            }
            return pybullet.GEOM_HEIGHTFIELD, collision, None


def _vertex_normals(mesh: Mesh) -> FloatArray:
    """Return the unit normal of each vertex, shape (V, 3): the area-weighted mean of its triangles' normals."""
    a, b, c = np.moveaxis(mesh.vertices_m[mesh.triangles], 1, 0)
    total = np.zeros_like(mesh.vertices_m, np.float64)
    np.add.at(total, mesh.triangles, np.cross(b - a, c - a)[:, None])
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))
