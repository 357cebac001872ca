"""The bodies of a PyBullet world as meshes, for renderers of our own."""

import numpy as np
import pybullet

from voxdepth.types import FloatArray

from .. import frames
from ..bodies import Mesh
from ..types import IdImage
from ..world import World
from .meshes import mesh_of_body, moved

Pose = tuple[FloatArray, FloatArray]
"""Rotation from the frame of a body to the world, shape (3, 3), and its position [m], shape (3,)."""


class Mirror:
    """Visual shapes of all bodies of a world: first those that never move, then drones and movers."""

    def __init__(self, world: World) -> None:
        self._world = world
        fixed, moving = list(world.bodies), list(world.moving_ids)
        self.body_ids = [*fixed, *moving]
        meshes = [mesh_of_body(world, body) for body in self.body_ids]
        self.n_fixed = len(fixed)
        self.fixed = [moved(mesh, *self.pose(body)) for mesh, body in zip(meshes, fixed, strict=False)]
        """In the world."""
        self.moving = meshes[self.n_fixed :]
        """Each in the frame of its body."""
        self.body_of_triangle: IdImage = np.repeat(
            np.arange(len(meshes), dtype=np.int32), [len(mesh.triangles) for mesh in meshes]
        )
        """Index into `body_ids`, shape (T,), for the triangles of the fixed and then of the moving meshes."""

    def moving_poses(self) -> list[Pose]:
        """Where what moves is now."""
        return [self.pose(body) for body in self.body_ids[self.n_fixed :]]

    def moving_now(self) -> list[Mesh]:
        """What moves, in the world."""
        return [moved(mesh, *pose) for mesh, pose in zip(self.moving, self.moving_poses(), strict=True)]

    def pose(self, body: int) -> Pose:
        """Where a body is now."""
        position_m, q_xyzw = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._world.client)
        return frames.rotation_from_quaternion(np.array(q_xyzw)), np.array(position_m)
