"""A Gymnasium environment: one follower learns, the mission's controller flies all others."""

from functools import partial
from typing import Any, SupportsFloat

import cv2
import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.vector import AsyncVectorEnv

from .episode import require_followers
from .learner import ACTION_SIZE, Observation
from .task import LearningTask
from .view import RENDER_MODES, EpisodeView, Image

Action = npt.NDArray[np.float32]
"""Speeds forward, left and up, and the turn to the left, within -1..1, shape (4,)."""


def observation_space(task: LearningTask) -> spaces.Space[Any]:
    """Return the space of `learner.Observation`."""
    max_speed_m_s, lost_m, shape = task.airframe.max_speed_m_s, task.mission.lost_m, task.rig.intrinsics.shape
    nearness = spaces.Box(0, 255, (1, *shape), np.uint8)
    if task.observation == "image":
        return nearness
    depth_m = spaces.Box(0.0, task.rig.max_depth_m, shape, np.float32)
    return spaces.Dict(
        {
            **({"depth_m": depth_m} if task.observation == "metres" else {"nearness": nearness}),
            "velocity_m_s": spaces.Box(-max_speed_m_s, max_speed_m_s, (3,), np.float32),
            "leader_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
            "slot_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
        }
    )


def action_space() -> spaces.Space[Any]:
    """Return the space of actions; see `learner.Learner`."""
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)


class LeaderFollowerEnv(gymnasium.Env[Observation, Action]):
    """Learn to follow a leader through a world seen by a corrected depth camera.

    `gymnasium.make("swarm:voxdepth/LeaderFollower-v0", **options)` makes one. Observations are described at
    `learner.Observation`, actions at `learner.Learner`, rewards at `task.RewardConfig`, and the end of an episode at
    `episode.StepResult`. `info` holds the `seed` of the episode, `time_s`, and when it has ended the `outcome`.

    Args:
        learner: Number of the learning drone; None takes the first follower.
        render_mode: `rgb_array`, or None for no pictures.
        task: As for `LearningTask.of`. What is unknown or impossible is a `MissionError`.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(self, *, learner: int | None = None, render_mode: str | None = None, **task: Any) -> None:
        self._task = LearningTask.of(**task)
        self._learner = self._task.followers[0] if learner is None else learner
        require_followers(self._task, [self._learner])
        self._view = EpisodeView(self._task, render_mode)
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(self._task.rig.rate_hz)}
        self.observation_space = observation_space(self._task)
        self.action_space = action_space()

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a seed; None draws the next one from `np_random`. `options` have no effect."""
        super().reset(seed=seed)
        episode_seed = int(self.np_random.integers(2**32)) if seed is None else seed
        episode = self._view.begin([self._learner], episode_seed)
        return episode.observe(self._learner), episode.info()

    def step(self, action: Action) -> tuple[Observation, SupportsFloat, bool, bool, dict[str, Any]]:
        """Fly for one camera period; without an episode, or for an unusable action, this is a `MissionError`."""
        episode = self._view.episode
        result = episode.step({self._learner: action})[self._learner]
        observation = episode.observe(self._learner)
        return observation, result.reward, result.terminated, result.truncated, episode.info()

    def render(self) -> Image | None:
        """Return the picture of the learner, shape (H, W, 3), RGB; None without a render mode."""
        return self._view.render()

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._view.close()


def vector_env(num_envs: int, **options: Any) -> AsyncVectorEnv:
    """Make environments with the options of `LeaderFollowerEnv`, each in a process of its own, on one thread."""
    return AsyncVectorEnv([partial(_on_one_thread, **options)] * num_envs, context="spawn")


def _on_one_thread(**options: Any) -> LeaderFollowerEnv:
    cv2.setNumThreads(1)
    return LeaderFollowerEnv(**options)
