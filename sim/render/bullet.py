"""PyBullet's own renderers. They are slow, and serve as the reference for the depth of the others.

Their gray images have one noise texture on all textured bodies and the sun of the weather, but no haze or clouds.
"""

import importlib.util
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from voxdepth.arithmetic import matmul
from voxdepth.types import FloatArray, Intrinsics

from .. import frames
from ..bodies import Body, Mesh
from ..engine import pybullet
from ..errors import RenderError
from ..solids import apply_texture, create_body
from ..types import Camera, CameraImages, Pinhole
from ..world import World

FAR_M = 2000.0
SKY_GRAY = 200
PLUGIN_POSTFIX = "_eglRendererPlugin"
PROBE_TIMEOUT_S = 60


@dataclass(frozen=True, kw_only=True)
class Engine:
    """Properties of one of PyBullet's renderers."""

    flag: int
    sample_px: tuple[float, float]
    """Position of the sample in a pixel, to the right and down."""
    near_m: float
    """Distance of the near clipping plane."""


TINY = Engine(flag=pybullet.ER_TINY_RENDERER, sample_px=(0.0, 1.0), near_m=0.05)
# The depth buffer has 16 bits: steps of 8 mm at 7 m, 6 cm at 20 m, with the near plane here.
EGL = Engine(flag=pybullet.ER_BULLET_HARDWARE_OPENGL, sample_px=(0.5, 0.5), near_m=0.1)


class TinyRenderer:
    """PyBullet's software renderer, which works on every machine."""

    def __init__(self, world: World) -> None:
        self._client = world.client
        self._sun = world.scene.weather.to_sun

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[CameraImages]:
        """Return one `CameraImages` per camera of the present state of the world, always with gray images."""
        return [_camera_image(camera, TINY, self._client, self._sun) for camera in cameras]


class EglRenderer:
    """OpenGL without a display, through PyBullet's EGL plugin, on a GPU or in software with Mesa.

    The plugin draws only bodies that are created after it was loaded. The renderer therefore has its own client with
    copies of all bodies, and updates the poses of the moving copies before each batch.
    """

    def __init__(self, world: World) -> None:
        plugin = egl_plugin()
        self._world = world
        self._client = pybullet.connect(pybullet.DIRECT)
        self._end = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        if pybullet.loadPlugin(plugin, PLUGIN_POSTFIX, physicsClientId=self._client) < 0:
            raise RenderError(f"PyBullet does not load its plugin {plugin} a second time: use raycast")
        copies = {self._copy(body): real for real, body in world.described.items()}
        self._moving = {copy: real for copy, real in copies.items() if real not in world.bodies}
        described = {copy: world.described[real] for copy, real in copies.items()}
        apply_texture(described, world.scene.seed, self._client)
        self._real = np.full(max(copies, default=-1) + 2, -1, np.int32)
        self._real[[copy + 1 for copy in copies]] = list(copies.values())

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[CameraImages]:
        """Return one `CameraImages` per camera of the present state of the world, always with gray images."""
        for copy, real in self._moving.items():
            position, q_xyzw = pybullet.getBasePositionAndOrientation(real, physicsClientId=self._world.client)
            pybullet.resetBasePositionAndOrientation(copy, position, q_xyzw, physicsClientId=self._client)
        return [self._render(camera) for camera in cameras]

    def _render(self, camera: Camera) -> CameraImages:
        seen = _camera_image(camera, EGL, self._client, self._world.scene.weather.to_sun)
        return replace(seen, segment_id=self._real[seen.segment_id + 1])

    def _copy(self, body: Body) -> int:
        """Copy a body. A mesh goes through a file, because the plugin confuses meshes that come from memory."""
        if not isinstance(body.shape, Mesh):
            return create_body(body, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{body.name}.obj"
            vertices = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in body.shape.vertices_m.tolist()]
            faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in body.shape.triangles.tolist()]
            path.write_text("\n".join([*vertices, *faces, ""]), encoding="ascii")
            look: Any = {"rgbaColor": [body.surface.albedo] * 3 + [1], "specularColor": [0, 0, 0]}
            visual = pybullet.createVisualShape(
                pybullet.GEOM_MESH, fileName=str(path), **look, physicsClientId=self._client
            )
            q_xyzw = frames.quaternion_from_yaw(body.yaw_rad).tolist()
            return int(pybullet.createMultiBody(0, -1, visual, body.position_m, q_xyzw, physicsClientId=self._client))


@cache
def egl_plugin() -> str:
    """Return the path of PyBullet's EGL plugin, after a trial in another process, since a failure ends its process.

    A plugin that is missing, or does not work on this machine, raises a `RenderError`.
    """
    found = importlib.util.find_spec("eglRenderer")
    if found is None or found.origin is None:
        raise RenderError("the renderer 'egl' needs PyBullet's plugin eglRenderer, which this wheel lacks: use raycast")
    probe = (
        "import sys, pybullet as p; c = p.connect(p.DIRECT); "
        f"p.loadPlugin({found.origin!r}, {PLUGIN_POSTFIX!r}, physicsClientId=c) >= 0 or sys.exit(1); "
        "p.getCameraImage(8, 8, renderer=p.ER_BULLET_HARDWARE_OPENGL, physicsClientId=c)"
    )
    try:
        subprocess.run([sys.executable, "-P", "-c", probe], capture_output=True, check=True, timeout=PROBE_TIMEOUT_S)
    except subprocess.SubprocessError as error:
        raise RenderError(
            "the renderer 'egl' does not work here: install a GPU driver, or Mesa's libegl1 and libgl1-mesa-dri, "
            "or use raycast"
        ) from error
    return found.origin


def _camera_image(camera: Camera, engine: Engine, client: int, to_sun: tuple[float, float, float]) -> CameraImages:
    intrinsics = camera.intrinsics
    _, _, rgba, buffer, segments = pybullet.getCameraImage(
        intrinsics.width_px,
        intrinsics.height_px,
        view_matrix(camera.T_world_cam),
        projection_matrix(intrinsics, engine),
        lightDirection=to_sun,
        shadow=0,
        renderer=engine.flag,
        physicsClientId=client,
    )
    shape = intrinsics.shape
    segment_id = np.reshape(segments, shape).astype(np.int32)
    empty = segment_id < 0
    gray = np.reshape(rgba, (*shape, 4))[..., 0].astype(np.uint8)
    gray[empty] = SKY_GRAY
    z_buffer = np.reshape(buffer, shape).astype(np.float64)
    depth_m = (FAR_M * engine.near_m / (FAR_M - (FAR_M - engine.near_m) * z_buffer)).astype(np.float32)
    depth_m[empty] = np.inf
    return CameraImages(gray=gray, depth_m=depth_m, segment_id=segment_id, T_world_cam=camera.T_world_cam)


def view_matrix(T_world_cam: FloatArray) -> list[float]:
    """Return the OpenGL view matrix, column-major, of a camera pose with any roll."""
    R_cam_world = T_world_cam[:3, :3].T
    T_opengl_world = np.eye(4)
    T_opengl_world[:3] = np.column_stack([R_cam_world, -matmul(R_cam_world, T_world_cam[:3, 3])])
    T_opengl_world[1:3] *= -1  # In OpenGL, y points up and z back.
    return list(T_opengl_world.T.ravel().tolist())


def projection_matrix(intrinsics: Intrinsics | Pinhole, engine: Engine) -> list[float]:
    """Return the OpenGL projection matrix, column-major, whose samples are at integer pixel coordinates.

    OpenGL samples the centre of each pixel, and TinyRenderer its lower left corner.
    """
    i, (right_px, down_px), near_m = intrinsics, engine.sample_px, engine.near_m
    left = -(i.cx_px + right_px) / i.fx_px * near_m
    right = (i.width_px - right_px - i.cx_px) / i.fx_px * near_m
    top = (i.cy_px + down_px) / i.fy_px * near_m
    bottom = -(i.height_px - down_px - i.cy_px) / i.fy_px * near_m
    return list(pybullet.computeProjectionMatrix(left, right, bottom, top, near_m, FAR_M))
