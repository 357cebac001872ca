"""The visible shapes of a URDF file, read by PyBullet."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pybullet_data

from voxdepth.types import FloatArray

from .bodies import Mesh
from .engine import pybullet, silenced
from .errors import SceneError
from .frames import rotation_from_quaternion
from .render.meshes import box, cylinder, moved, open3d, sphere

LUMINANCE = np.array([0.299, 0.587, 0.114])
"""Shares of red, green and blue in gray (ITU-R BT.601)."""


def parts_of(path: Path, scale: float = 1.0) -> Iterator[tuple[str, Mesh, float]]:
    """Yield the visible shapes of all links, enlarged by a factor, with all joints at zero.

    Each has the name of its link, its mesh in the frame of the root link, and the gray of its colour, 0..1.

    Raises:
        SceneError: PyBullet cannot read the file, or a shape of it has no surface.
    """
    client = pybullet.connect(pybullet.DIRECT)
    pybullet.setAdditionalSearchPath(pybullet_data.getDataPath(), physicsClientId=client)
    try:
        with silenced():
            robot = pybullet.loadURDF(str(path), useFixedBase=True, globalScaling=scale, physicsClientId=client)
        shapes = pybullet.getVisualShapeData(robot, physicsClientId=client)
        if not shapes:
            raise SceneError(f"expected visible shapes in {path}, got none: give its links a <visual> that can be read")
        for _, link, kind, size_m, file, *pose, rgba in shapes:
            name, link_pose = pybullet.getBodyInfo(robot, physicsClientId=client)[0], ((0, 0, 0), (0, 0, 0, 1))
            if link >= 0:
                name = pybullet.getJointInfo(robot, link, physicsClientId=client)[12]
                link_pose = pybullet.getLinkState(robot, link, physicsClientId=client)[4:6]
            for mesh in _meshes(kind, np.array(size_m), file.decode(), path):
                yield name.decode(), _placed(_placed(mesh, pose), link_pose), float(LUMINANCE @ rgba[:3])
    except pybullet.error as error:
        raise SceneError(
            f"expected a URDF file that PyBullet reads with its meshes, got {path} ({error}): give its path from "
            "the folder of the scenario, from the current one or from that of pybullet_data"
        ) from error
    finally:
        pybullet.disconnect(physicsClientId=client)


def _placed(mesh: Mesh, pose: Any) -> Mesh:
    return moved(mesh, rotation_from_quaternion(np.array(pose[1])), np.array(pose[0]))


def _meshes(kind: int, size_m: FloatArray, file: str, path: Path) -> Iterator[Mesh]:
    """The closed surfaces of a shape in its own frame; `size_m` are PyBullet's `dimensions` of it."""
    if kind == pybullet.GEOM_BOX:
        yield box(size_m)
    elif kind == pybullet.GEOM_SPHERE:
        yield sphere(size_m[0])
    elif kind in (pybullet.GEOM_CYLINDER, pybullet.GEOM_CAPSULE):
        height_m, radius_m = size_m[:2]
        yield cylinder(radius_m=radius_m, height_m=height_m)
        for end_m in (-height_m / 2, height_m / 2) if kind == pybullet.GEOM_CAPSULE else ():
            yield moved(sphere(radius_m), np.eye(3), np.array([0, 0, end_m]))
    else:
        library = open3d()
        with library.utility.VerbosityContextManager(library.utility.VerbosityLevel.Error):
            read = library.io.read_triangle_mesh(file)
        if not read.has_triangles():
            raise SceneError(f"expected triangles in {file!r} of {path}, got none: give the mesh as .obj, .stl or .ply")
        triangles = np.asarray(read.triangles, np.uint32)
        yield Mesh(np.asarray(read.vertices) * size_m, triangles[:, ::-1] if size_m.prod() < 0 else triangles)
