"""The present episode of an environment, and its picture."""

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from sim import frames
from sim.render import create_renderer
from sim.types import Camera, Renderer
from voxdepth.colors import colored
from voxdepth.types import Intrinsics

from ..errors import MissionError
from ..recorder import Recorder
from .episode import Episode
from .task import LearningTask, from_testbed

Image = npt.NDArray[np.uint8]
"""Shape (H, W, 3), RGB."""

RENDER_MODES = ("rgb_array",)
PANEL_HEIGHT_PX, WIDE_DEG = 240, 100.0
"""Height of each image of a picture, and the horizontal field of view of the one from behind."""
BEHIND_M = np.array([0.0, -1.2, -4.0])
"""From the camera of a learner to that behind it, in its frame: x right, y down, z forward."""


class EpisodeView:
    """The present episode of an environment, its recording and its picture; without an episode a `MissionError`."""

    def __init__(self, task: LearningTask, render_mode: str | None) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
        self._task = task
        self._render_mode = render_mode
        self._learners: Sequence[int] = ()
        self._episode: Episode | None = None
        self._renderer: Renderer | None = None

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
        if self._render_mode is not None:
            self._renderer = create_renderer(self._task.renderer, self._episode.world)
        return self._episode

    def render(self) -> Image | None:
        """Return what the first learner sees, in gray and as depth, over a view of it from behind, or None."""
        if self._render_mode is None:
            return None
        rig, world, learner = self._task.rig, self.episode.world, self._learners[0]
        seen, pose = self.episode.situation(learner).percept, world.pose(learner)
        assert seen is not None and self._renderer is not None, "an episode begins with an image"
        own = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, rig.left_mount_m)
        behind = own.copy()
        behind[:3, 3] += own[:3, :3] @ BEHIND_M
        size = round(PANEL_HEIGHT_PX * rig.width_px / rig.height_px), PANEL_HEIGHT_PX
        wide = Intrinsics.from_hfov(width_px=2 * size[0], height_px=size[1], hfov_deg=WIDE_DEG)
        views = [Camera(T_world_cam=own, intrinsics=rig.intrinsics), Camera(T_world_cam=behind, intrinsics=wide)]
        gray, lower = (np.repeat(self._renderer.render([view])[0].gray[..., None], 3, axis=2) for view in views)
        upper = gray, colored(seen.corrected.depth_m, rig.max_depth_m)[..., ::-1]
        panels = [cv2.resize(image, size, interpolation=cv2.INTER_NEAREST) for image in upper]
        return np.vstack([np.hstack(panels), lower]).astype(np.uint8)

    def close(self) -> None:
        """Free the world and finish the recording; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None
