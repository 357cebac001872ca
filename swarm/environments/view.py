"""Pictures of an episode: the image of a learner, and a map of the swarm."""

from collections.abc import Callable, Collection, Sequence

import cv2
import numpy as np
import numpy.typing as npt

from sim import frames
from sim.bodies import Body, Box, Cylinder, Sphere
from sim.world import World
from voxdepth.colors import colored
from voxdepth.types import FloatArray, FloatImage, GrayImage

from ..errors import MissionError
from ..recorder import CaptureRecorder
from ..team import Team
from .episode import Episode
from .task import LearningTask

Image = npt.NDArray[np.uint8]
"""Shape (H, W, 3), RGB."""

RENDER_MODES = ("rgb_array",)
PANEL_HEIGHT_PX = 240
MAP_MARGIN_M = 8.0
DRONE_RADIUS_PX = 4
GROUND, BUILDING, GOAL = (238, 238, 232), (160, 160, 165), (40, 160, 60)
SCRIPTED, LEADER, LEARNER = (60, 60, 60), (30, 90, 220), (220, 40, 40)


def _panel(gray: GrayImage, depth_m: FloatImage, max_depth_m: float) -> Image:
    """Return a gray image beside its depth in colours, near red, far blue, holes black; 240 rows."""
    width_px = round(PANEL_HEIGHT_PX * gray.shape[1] / gray.shape[0])
    images = np.repeat(gray[..., None], 3, axis=2), colored(depth_m, max_depth_m)[..., ::-1]
    size, method = (width_px, PANEL_HEIGHT_PX), cv2.INTER_NEAREST
    return np.hstack([cv2.resize(image, size, interpolation=method) for image in images]).astype(np.uint8)


def _map(world: World, teams: Sequence[Team], learners: Collection[int], width_px: int) -> Image:
    """Draw a map, x to the right and y up: leaders blue, learners red, other drones dark, goals as green crosses."""
    ends_m = np.vstack([[team.start_m[:2], team.goal_m[:2]] for team in teams])
    low_m, high_m = ends_m.min(axis=0) - MAP_MARGIN_M, ends_m.max(axis=0) + MAP_MARGIN_M
    width_m, height_m = high_m - low_m
    px_per_m = width_px / width_m
    image: Image = np.full((round(height_m * px_per_m), width_px, 3), GROUND, np.uint8)

    def pixel(position_m: FloatArray) -> tuple[int, int]:
        x, y = (position_m[:2] - low_m) * px_per_m
        return round(x), len(image) - 1 - round(y)

    for body in [*world.bodies.values(), *world.movers_now()]:
        if body.kind != "ground":
            _draw_body(image, body, pixel, px_per_m)
    for team in teams:
        cv2.drawMarker(image, pixel(team.goal_m), GOAL, cv2.MARKER_CROSS, 12, 2)
    leaders = {team.leader for team in teams}
    for drone, state in enumerate(world.states):
        color = LEARNER if drone in learners else LEADER if drone in leaders else SCRIPTED
        yaw_rad = frames.yaw_from_quaternion(state.q_world_body_xyzw)
        ahead_m = state.position_m[:2] + 1.2 * np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
        cv2.line(image, pixel(state.position_m), pixel(ahead_m), color, 1, cv2.LINE_AA)
        cv2.circle(image, pixel(state.position_m), DRONE_RADIUS_PX, color, cv2.FILLED, cv2.LINE_AA)
    return image


def _draw_body(image: Image, body: Body, pixel: Callable[[FloatArray], tuple[int, int]], px_per_m: float) -> None:
    """Draw a box as its outline and a round body as a circle; other shapes are left out."""
    match body.shape:
        case Box(size_m=(x_m, y_m, _)):
            turn = frames.rotation_from_yaw(body.yaw_rad)[:2, :2]
            corners_m = np.array([[x_m, y_m], [-x_m, y_m], [-x_m, -y_m], [x_m, -y_m]]) / 2 @ turn.T
            corners = np.array([pixel(corner + body.position_m[:2]) for corner in corners_m], np.int32)
            cv2.fillPoly(image, [corners], BUILDING)
        case Cylinder(radius_m=radius_m) | Sphere(radius_m=radius_m):
            radius_px = max(2, round(radius_m * px_per_m))
            cv2.circle(image, pixel(np.array(body.position_m)), radius_px, BUILDING, cv2.FILLED)


class EpisodeView:
    """The present episode of an environment, and its pictures.

    Raises:
        MissionError: There is no such render mode, or a call needs an episode and there is none.
    """

    def __init__(self, task: LearningTask, render_mode: str | None) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
        self._task = task
        self._images = None if render_mode is None else CaptureRecorder()
        self._learners: Sequence[int] = ()
        self._episode: Episode | None = None

    @property
    def episode(self) -> Episode:
        """The present episode."""
        if self._episode is None:
            raise MissionError("there is no episode: call reset() first, also after close()")
        return self._episode

    def begin(self, learners: Sequence[int], seed: int) -> Episode:
        """Close the present episode and begin another one."""
        self.close()
        self._learners = learners
        self._episode = Episode(self._task, learners, seed=seed, recorder=self._images)
        return self._episode

    def render(self) -> Image | None:
        """Return the image of the first learner over a map, shape (H, W, 3), RGB; None without a render mode."""
        if self._images is None:
            return None
        world = self.episode.world
        capture, corrected = self._images.newest[self._learners[0]]
        panel = _panel(capture.gray_left, corrected.depth_m, self._task.rig.max_depth_m)
        return np.vstack([panel, _map(world, self._task.mission.teams(), self._learners, panel.shape[1])])

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None
