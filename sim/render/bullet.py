"""PyBullet's own renderers: slow, and the reference for the depth of the others.

Their gray images are plain: one noise texture on all that is not blank, the sun of the weather, no haze and no clouds.
"""

import importlib.util
import subprocess
import sys
import tempfile
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pybullet

from voxdepth.types import FloatArray, Intrinsics

from .. import frames
from ..bodies import Body, Mesh
from ..errors import RenderError
from ..solids import apply_texture, create_body, create_shapes
from ..types import Camera, Images
from ..world import DRONE_SURFACE, World, drone_shape

FAR_M = 2000.0
SKY_GRAY = 200
PLUGIN_POSTFIX = "_eglRendererPlugin"
PROBE_TIMEOUT_S = 60


@dataclass(frozen=True, kw_only=True)
class Engine:
    """How one of PyBullet's renderers behaves."""

    flag: int
    sample_px: tuple[float, float]
    """Where in a pixel it samples, to the right and down."""
    near_m: float
    """Nothing nearer is drawn."""


TINY = Engine(flag=pybullet.ER_TINY_RENDERER, sample_px=(0.0, 1.0), near_m=0.05)
# The depth buffer has 16 bits: steps of 8 mm at 7 m, 6 cm at 20 m, with the near plane here.
EGL = Engine(flag=pybullet.ER_BULLET_HARDWARE_OPENGL, sample_px=(0.5, 0.5), near_m=0.1)


class TinyRenderer:
    """The software renderer: needs nothing. One camera after the other."""

    def __init__(self, world: World) -> None:
        self._client = world.client
        self._sun = world.scene.weather.to_sun

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now; `gray` comes anyhow."""
        return [_camera_image(camera, TINY, self._client, self._sun) for camera in cameras]


class EglRenderer:
    """OpenGL without a display, through PyBullet's EGL plugin; on a GPU, or in software on Mesa.

    The plugin draws only what is created after it was loaded, so the renderer keeps a client of its own with copies of
    all bodies and moves the copies of drones and movers before each batch.
    """

    def __init__(self, world: World) -> None:
        plugin = egl_plugin()
        self._world = world
        self._client = pybullet.connect(pybullet.DIRECT)
        self._end = weakref.finalize(self, pybullet.disconnect, physicsClientId=self._client)
        if pybullet.loadPlugin(plugin, PLUGIN_POSTFIX, physicsClientId=self._client) < 0:
            raise RenderError(f"PyBullet does not load its plugin {plugin} a second time: use raycast")
        static = {self._copy(body): real for real, body in world.bodies.items()}
        drones = {self._add_drone(): real for real in world.drone_ids}
        self._moving = {self._copy(body): real for real, body in world.movers.items()} | drones
        copies = {**static, **self._moving}
        textured = set(world.textured_ids)
        apply_texture([copy for copy, real in copies.items() if real in textured], world.scene.seed, self._client)
        self._real = np.full(max(copies, default=-1) + 2, -1, np.int32)
        self._real[[copy + 1 for copy in copies]] = list(copies.values())

    def render(self, cameras: Sequence[Camera], *, gray: bool = True) -> list[Images]:
        """One `Images` per camera, of the world as it is now; `gray` comes anyhow."""
        for copy, real in self._moving.items():
            position, q_xyzw = pybullet.getBasePositionAndOrientation(real, physicsClientId=self._world.client)
            pybullet.resetBasePositionAndOrientation(copy, position, q_xyzw, physicsClientId=self._client)
        return [self._render(camera) for camera in cameras]

    def _render(self, camera: Camera) -> Images:
        seen = _camera_image(camera, EGL, self._client, self._world.scene.weather.to_sun)
        return Images(gray=seen.gray, depth_m=seen.depth_m, segment_id=self._real[seen.segment_id + 1])

    def _copy(self, body: Body) -> int:
        """The plugin takes all meshes from memory for one and the same: they go through files."""
        if not isinstance(body.shape, Mesh):
            return create_body(body, self._client)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{body.name}.obj"
            path.write_text(wavefront(body.shape), encoding="ascii")
            color = [body.surface.albedo] * 3 + [1]
            visual = pybullet.createVisualShape(
                pybullet.GEOM_MESH,
                fileName=str(path),
                rgbaColor=color,
                specularColor=[0, 0, 0],
                physicsClientId=self._client,
            )
            q_xyzw = frames.quaternion_from_yaw(body.yaw_rad).tolist()
            return int(pybullet.createMultiBody(0, -1, visual, body.position_m, q_xyzw, physicsClientId=self._client))

    def _add_drone(self) -> int:
        _, visual = create_shapes(drone_shape(self._world.airframe.radius_m), DRONE_SURFACE, self._client)
        return int(pybullet.createMultiBody(0, -1, visual, [0, 0, 0], [0, 0, 0, 1], physicsClientId=self._client))


@cache
def egl_plugin() -> str:
    """Path of PyBullet's EGL plugin, after a picture was taken with it: where it fails it ends the whole process.

    Raises:
        RenderError: There is no plugin, or it does not work on this machine.
    """
    found = importlib.util.find_spec("eglRenderer")
    if found is None or found.origin is None:
        raise RenderError("the renderer 'egl' needs PyBullet's plugin eglRenderer, which this wheel lacks: use raycast")
    probe = (
        "import pybullet as p; c = p.connect(p.DIRECT); "
        f"assert p.loadPlugin({found.origin!r}, {PLUGIN_POSTFIX!r}, physicsClientId=c) >= 0; "
        "p.getCameraImage(8, 8, renderer=p.ER_BULLET_HARDWARE_OPENGL, physicsClientId=c)"
    )
    try:
        subprocess.run([sys.executable, "-c", probe], capture_output=True, check=True, timeout=PROBE_TIMEOUT_S)
    except subprocess.SubprocessError as error:
        raise RenderError(
            "the renderer 'egl' does not work here: install a GPU driver, or Mesa's libegl1 and libgl1-mesa-dri, "
            "or use raycast"
        ) from error
    return found.origin


def wavefront(mesh: Mesh) -> str:
    """A mesh as the text of an .obj file."""
    vertices = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in mesh.vertices_m.tolist()]
    faces = [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles.tolist()]
    return "\n".join([*vertices, *faces, ""])


def _camera_image(camera: Camera, engine: Engine, client: int, to_sun: tuple[float, float, float]) -> Images:
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
    nothing = segment_id < 0
    gray = np.reshape(rgba, (*shape, 4))[..., 0].astype(np.uint8)
    gray[nothing] = SKY_GRAY
    depth_m = metric_depth(np.reshape(buffer, shape).astype(np.float64), engine.near_m).astype(np.float32)
    depth_m[nothing] = np.inf
    return Images(gray=gray, depth_m=depth_m, segment_id=segment_id)


def view_matrix(T_world_cam: FloatArray) -> list[float]:
    """OpenGL view matrix, column-major, of a camera pose with any roll."""
    to_opengl = np.diag([1.0, -1.0, -1.0, 1.0])
    view: list[float] = (to_opengl @ np.linalg.inv(T_world_cam)).T.ravel().tolist()
    return view


def projection_matrix(intrinsics: Intrinsics, engine: Engine) -> list[float]:
    """OpenGL projection, column-major, with which an engine samples at the integer pixels of `intrinsics`.

    OpenGL samples the centre of each pixel, TinyRenderer its lower left corner.
    """
    i, (right_px, down_px), near_m = intrinsics, engine.sample_px, engine.near_m
    left = -(i.cx_px + right_px) / i.fx_px * near_m
    right = (i.width_px - right_px - i.cx_px) / i.fx_px * near_m
    top = (i.cy_px + down_px) / i.fy_px * near_m
    bottom = -(i.height_px - down_px - i.cy_px) / i.fy_px * near_m
    matrix: list[float] = list(pybullet.computeProjectionMatrix(left, right, bottom, top, near_m, FAR_M))
    return matrix


def metric_depth(buffer: FloatArray, near_m: float) -> FloatArray:
    """Depth [m] of an OpenGL depth buffer with values in 0..1."""
    return FAR_M * near_m / (FAR_M - (FAR_M - near_m) * buffer)
