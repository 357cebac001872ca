"""Films of missions: the swarm among the bodies, from a camera that follows it, beside the depth of one drone."""

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from sim.bodies import Scene
from sim.frames import rotation_from_yaw
from sim.render.meshes import mesh_of_shape, moved
from swarm.recorder import CaptureRecorder
from voxdepth.colors import FAR_M, colored
from voxdepth.tools.files import write
from voxdepth.types import FloatArray, FloatImage

from .config import Run
from .errors import ScenarioError
from .images import DRONE_COLORS, Image, drone_color, titled
from .mission_pictures import require_drone
from .runner import flying

SIZE_PX = (480, 322)
"""Width and height of the view of the world."""
PANEL_PX = (160, 90)
FOCAL_PX = 370.0
EYE_M, LOOK_AT_M = np.array([-14.0, -5.0, 22.0]), np.array([5.0, 0.0, -3.0])
"""Where the camera is and where it looks, relative to the middle of the swarm."""
NEAREST_M = 1.0
STEP_S, SHOWN_S = 0.4, 0.15
"""Simulated time between two images, and how long each is shown."""
TRAIL_IMAGES = 10
"""Length of the trails."""
FOLLOWING = 0.25
"""Share of the way to the middle of the swarm by which the camera follows from image to image."""
GROUND, INK = (226, 231, 233), (60, 60, 60)
TINT = np.array([1.0, 0.96, 0.92])
"""Colour of the bodies, BGR."""
SUN = np.array([-0.4, -0.55, 0.73])
SHADES, DEPTHS = 16, 14
"""Numbers of colours of bodies and of depths in the palette of a film."""


class Faces(NamedTuple):
    """Triangles of all bodies above the ground."""

    corners_m: FloatArray
    """Shape (n, 3, 3), world frame."""
    normals: FloatArray
    """Shape (n, 3), outwards."""
    shade: FloatArray
    """Brightness in 0..1, shape (n,)."""
    body_m: FloatArray
    """Middle (x, y) of the body of each triangle, shape (n, 2)."""


def make_film(run: Run, path: Path, *, drone: int, until_s: float) -> None:
    """Fly until `until_s`, or to the end of the mission, and write an animated GIF; a failure is a `ToolError`."""
    if path.suffix.lower() != ".gif":
        raise ScenarioError(f"a film must be a .gif file, got {path}")
    require_drone(run, drone)
    scene = run.scenario.scene.build(run.seed)
    faces, recorder = faces_of(scene), CaptureRecorder()
    images: list[Image] = []
    with flying(run, recorder, recorded=True) as mission:
        flown_m: list[FloatArray] = []
        middle_m = np.zeros(3)
        while mission.outcome is None and mission.time_s < until_s:
            mission.tick()
            if mission.time_s < STEP_S * len(images) or drone not in recorder.newest:
                continue
            flown_m.append(np.array([state.position_m for state in mission.world.states]))
            now_m = flown_m[-1].mean(axis=0)
            middle_m = now_m if not images else middle_m + FOLLOWING * (now_m - middle_m)
            capture, corrected = recorder.newest[drone]
            world = draw_world(faces, flown_m[-TRAIL_IMAGES:], middle_m)
            depths_m = {"true": capture.depth_true_m, "raw": capture.depth_raw_m, "corrected": corrected.depth_m}
            column = [titled(f"depth, {name}", _panel(depth_m)) for name, depth_m in depths_m.items()]
            world = titled(f"{run.scenario.name}, {mission.time_s:.1f} s", world)
            images.append(np.hstack([world, np.vstack(column)]))
    write(path, gif(images))


def faces_of(scene: Scene) -> Faces:
    """Return the triangles of all bodies but the ground, lit by the sun."""
    corners, shades, middles = [], [], []
    for body in scene.bodies:
        if body.kind == "ground":
            continue
        mesh = moved(mesh_of_shape(body.shape), rotation_from_yaw(body.yaw_rad), np.array(body.position_m))
        corners.append(mesh.vertices_m[mesh.triangles])
        middles.append(np.tile(mesh.vertices_m[:, :2].mean(axis=0), (len(mesh.triangles), 1)))
        shades.append(np.full(len(mesh.triangles), 0.35 + 0.5 * body.surface.albedo))
    corners_m, albedo = np.concatenate(corners), np.concatenate(shades)
    normals = np.cross(corners_m[:, 1] - corners_m[:, 0], corners_m[:, 2] - corners_m[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return Faces(corners_m, normals, albedo * (0.55 + 0.45 * np.maximum(normals @ SUN, 0)), np.concatenate(middles))


def draw_world(faces: Faces, flown_m: Sequence[FloatArray], middle_m: FloatArray) -> Image:
    """Draw bodies from far to near, then the trails of the drones, whose positions have the shape (n, 3).

    The camera stands at `EYE_M` from `middle_m`, shape (3,). The result is BGR, shape (H, W, 3).
    """
    width, height = SIZE_PX
    eye_m = middle_m + EYE_M
    ahead = LOOK_AT_M - EYE_M
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    R = np.array([right, np.cross(ahead, right), ahead])

    def project(points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        cam_m = (points_m - eye_m) @ R.T
        z_m = np.maximum(cam_m[..., 2], 1e-6)
        return FOCAL_PX * cam_m[..., :2] / z_m[..., None] + np.array([width, height]) / 2, cam_m[..., 2]

    image: Image = np.full((height, width, 3), GROUND, np.uint8)
    corners_px, z_m = project(faces.corners_m)
    towards = ((faces.corners_m[:, 0] - eye_m) * faces.normals).sum(axis=1) < 0
    seen = np.flatnonzero(towards & (z_m.min(axis=1) > NEAREST_M))
    away_m = np.hypot(*(faces.body_m - eye_m[:2]).T)
    for face in seen[np.argsort(-away_m[seen], kind="stable")]:  # Bodies stand beside, not above, each other.
        color = (255 * faces.shade[face] * TINT).tolist()
        cv2.fillConvexPoly(image, np.rint(corners_px[face]).astype(np.int32), color)
    trails_px, _ = project(np.array(flown_m))
    for drone in range(trails_px.shape[1]):
        color = drone_color(drone)[::-1]
        cv2.polylines(image, [np.rint(trails_px[:, drone]).astype(np.int32)], False, color, 2)
        at = tuple(np.rint(trails_px[-1, drone]).astype(int).tolist())
        cv2.circle(image, at, 6, INK, cv2.FILLED)
        cv2.circle(image, at, 5, color, cv2.FILLED)
    return image


def gif(images: Sequence[Image]) -> bytes:
    """Encode images, BGR, as an animated GIF with `palette`."""
    from PIL import Image as Pictures

    colors = Pictures.new("P", (1, 1))
    colors.putpalette(palette()[:, ::-1].tobytes())
    shown = [Pictures.fromarray(np.ascontiguousarray(image[..., ::-1])) for image in images]
    first, *others = (image.quantize(palette=colors, dither=Pictures.Dither.NONE) for image in shown)
    data = BytesIO()
    first.save(data, "GIF", save_all=True, append_images=others, duration=round(1000 * SHOWN_S), loop=0)
    return data.getvalue()


def palette() -> Image:
    """Return the colours of films, BGR, shape (n, 3): drones, ink, bodies and depths; few depths make small files."""
    drones = [color[::-1] for color in DRONE_COLORS]
    bodies = np.linspace(60, 250, SHADES)[:, None] * TINT
    depths = colored(np.linspace(0.5, np.sqrt(FAR_M), DEPTHS, dtype=np.float32)[None] ** 2)[0]
    return np.vstack([drones, [GROUND, INK, (245, 245, 245), (0, 0, 0)], bodies, depths]).astype(np.uint8)


def _panel(depth_m: FloatImage) -> Image:
    return cv2.resize(colored(depth_m), PANEL_PX, interpolation=cv2.INTER_NEAREST).astype(np.uint8)
