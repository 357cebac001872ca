"""A Gymnasium environment: one follower learns, our controller flies all others."""

from typing import Any, SupportsFloat

import cv2
import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sim import frames
from sim.render import create_renderer
from sim.types import Camera
from voxdepth.types import Intrinsics

from ..errors import MissionError
from .episode import Episode
from .learner import ACTION_SIZE, Observation
from .task import LearningTask

Action = npt.NDArray[np.float32]
"""Speeds forward, left and up, and the turn to the left, within -1..1, shape (4,)."""
RENDER_MODES = ("rgb_array",)
PICTURE = Intrinsics.from_hfov(width_px=640, height_px=240, hfov_deg=100.0)
"""Camera that takes the pictures of the learner."""
BEHIND_M = np.array([0.0, -1.2, -4.0])
"""From the camera of the learner to that behind it, in its frame: x right, y down, z forward."""


class LeaderFollowerEnv(gymnasium.Env[Observation, Action]):
    """Learn to follow a leader through a world seen by a corrected depth camera.

    `gymnasium.make("swarm.gym:voxdepth/LeaderFollower-v0", **options)` makes one, which has OpenCV use one thread.
    Observations are described at `learner.Observation`, actions at `learner.Learner`, rewards at `task.RewardConfig`,
    and the end of an episode at `episode.StepResult`. `info` holds the `seed` of the episode, `time_s`, and when it has
    ended the `outcome`.

    Args:
        learner: Number of the learning drone; None takes the first follower.
        render_mode: `rgb_array`, or None for no pictures.
        task: As for `LearningTask.of`. What is unknown or impossible is a `MissionError`.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(self, *, learner: int | None = None, render_mode: str | None = None, **task: Any) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
        cv2.setNumThreads(1)
        self._task = LearningTask.of(**task)
        self._learner = self._task.followers[0] if learner is None else learner
        self._task.require_follower(self._learner)
        self._episode: Episode | None = None
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(self._task.rig.rate_hz)}
        self.observation_space = observation_space(self._task)
        self.action_space = spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a seed; None draws the next one from `np_random`. `options` have no effect."""
        super().reset(seed=seed)
        episode_seed = int(self.np_random.integers(2**32)) if seed is None else seed
        self.close()
        self._episode = Episode(self._task, self._learner, seed=episode_seed)
        if self.render_mode is not None:
            self._renderer = create_renderer(self._task.renderer, self._episode.world)
        return self._episode.observe(), self._episode.info()

    def step(self, action: Action) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Fly for one camera period; without an episode, or for an unusable action, this is a `MissionError`."""
        episode = self._present()
        result = episode.step(action)
        return episode.observe(), result.reward, result.terminated, result.truncated, episode.info()

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the learner from behind, shape (240, 640, 3), RGB; None without a render mode."""
        if self.render_mode is None:
            return None
        pose = self._present().world.pose(self._learner)
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, self._task.rig.left_mount_m)
        T_world_cam[:3, 3] += T_world_cam[:3, :3] @ BEHIND_M
        (image,) = self._renderer.render([Camera(T_world_cam=T_world_cam, intrinsics=PICTURE)])
        return np.repeat(image.gray[..., None], 3, axis=2)

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
            self._episode = None

    def _present(self) -> Episode:
        """Return the present episode."""
        if self._episode is None:
            raise MissionError("there is no episode: call reset() first, also after close()")
        return self._episode


def observation_space(task: LearningTask) -> spaces.Dict:
    """Return the space of `learner.Observation`."""
    max_speed_m_s, lost_m, shape = task.airframe.max_speed_m_s, task.mission.lost_m, task.rig.intrinsics.shape
    depth_m, nearness = (
        spaces.Box(0.0, task.rig.max_depth_m, shape, np.float32),
        spaces.Box(0, 255, (1, *shape), np.uint8),
    )
    return spaces.Dict(
        {
            **({"depth_m": depth_m} if task.observation == "metres" else {"nearness": nearness}),
            "velocity_m_s": spaces.Box(-max_speed_m_s, max_speed_m_s, (3,), np.float32),
            "leader_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
            "slot_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
        }
    )
