"""The present episode of an environment, and its picture."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from sim import frames
from sim.render import create_renderer
from sim.types import Camera
from voxdepth.colors import colored
from voxdepth.types import FloatArray, Intrinsics

from ..errors import MissionError
from ..recorder import Recorder
from .episode import Episode
from .task import LearningTask, from_testbed

Image = npt.NDArray[np.uint8]
"""Shape (H, W, 3), RGB."""

RENDER_MODES = ("rgb_array",)
PANEL_HEIGHT_PX, MAP_MARGIN_M, MAP_FROM_M = 240, 8.0, 150.0
"""Height of the upper images, extent of the map beyond the routes, and the height from which it is seen."""
DRONE_RADIUS_PX = 4
GOAL, OTHER, LEADER, LEARNER = (40, 160, 60), (60, 60, 60), (30, 90, 220), (220, 40, 40)


class EpisodeView:
    """The present episode of an environment, its recording and its picture.

    Raises:
        MissionError: There is no such render mode, or a call needs an episode and there is none.
    """

    def __init__(self, task: LearningTask, render_mode: str | None) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
        self._task = task
        self._render_mode = render_mode
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
        folder = self._task.record
        recorder = Recorder() if folder is None else from_testbed("recorder")(folder, self._task, seed)
        self._learners = learners
        self._episode = Episode(self._task, learners, seed=seed, recorder=recorder)
        return self._episode

    def render(self) -> Image | None:
        """Return the gray image and the depth of the first learner over a map; None without a render mode."""
        if self._render_mode is None:
            return None
        rig, world, learner = self._task.rig, self.episode.world, self._learners[0]
        seen = self.episode.situation(learner).percept
        assert seen is not None, "an episode begins with an image"
        pose = world.pose(learner)
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, rig.left_mount_m)
        own, above = Camera(T_world_cam=T_world_cam, intrinsics=rig.intrinsics), self._above()
        renderer = create_renderer(self._task.renderer, world)
        (own_view,), (map_view,) = renderer.render([own]), renderer.render([above])
        depth = colored(seen.corrected.depth_m, rig.max_depth_m)[..., ::-1]
        size = round(PANEL_HEIGHT_PX * rig.width_px / rig.height_px), PANEL_HEIGHT_PX
        panels = [cv2.resize(image, size, interpolation=cv2.INTER_NEAREST) for image in (_rgb(own_view.gray), depth)]
        return np.vstack([np.hstack(panels), self._marked(_rgb(map_view.gray), above)]).astype(np.uint8)

    def _above(self) -> Camera:
        """Return a camera that sees all routes from above, x to the right and y up."""
        ends_m = np.vstack([[team.start_m[:2], team.goal_m[:2]] for team in self._task.mission.teams()])
        low_m, high_m = ends_m.min(axis=0) - MAP_MARGIN_M, ends_m.max(axis=0) + MAP_MARGIN_M
        width_px = 2 * round(PANEL_HEIGHT_PX * self._task.rig.width_px / self._task.rig.height_px)
        px_per_m = width_px / (high_m - low_m)[0]
        height_px, focal_px = round((high_m - low_m)[1] * px_per_m), px_per_m * MAP_FROM_M
        T_world_cam = np.diag([1.0, -1.0, -1.0, 1.0])
        T_world_cam[:3, 3] = *((low_m + high_m) / 2), MAP_FROM_M
        center_px = {"cx_px": (width_px - 1) / 2, "cy_px": (height_px - 1) / 2}
        intrinsics = Intrinsics(
            fx_px=focal_px, fy_px=focal_px, **center_px, width_px=width_px, height_px=height_px, baseline_m=None
        )
        return Camera(T_world_cam=T_world_cam, intrinsics=intrinsics)

    def _marked(self, image: Image, camera: Camera) -> Image:
        """Mark the leaders blue, the learners red, the others dark, and the goals with green crosses, in place."""
        teams, i = self._task.mission.teams(), camera.intrinsics

        def pixel(position_m: FloatArray) -> tuple[int, int]:
            x, y, z = (position_m - camera.T_world_cam[:3, 3]) @ camera.T_world_cam[:3, :3]
            return round(i.cx_px + i.fx_px * x / z), round(i.cy_px + i.fy_px * y / z)

        for team in teams:
            cv2.drawMarker(image, pixel(team.goal_m), GOAL, cv2.MARKER_CROSS, 12, 2)
        leaders = {team.leader for team in teams}
        for drone, state in enumerate(self.episode.world.states):
            color = LEARNER if drone in self._learners else LEADER if drone in leaders else OTHER
            cv2.circle(image, pixel(state.position_m), DRONE_RADIUS_PX, color, cv2.FILLED, cv2.LINE_AA)
        return image

    def close(self) -> None:
        """Free the world and finish the recording; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None


def _rgb(gray: npt.NDArray[np.uint8]) -> Image:
    return np.repeat(gray[..., None], 3, axis=2)
