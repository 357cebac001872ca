"""A Gymnasium environment: one follower learns, our controller flies all others."""

from copy import deepcopy
from dataclasses import replace
from typing import Any

import cv2
import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec

from ..controllers import Role
from ..errors import MissionError
from ..mission import Mission
from ..pilot import Situation
from ..recorder import Recorder
from .episode import RENDER_MODES, Episode, checked_render_mode
from .learner import ACTION_SIZE, Observation
from .task import LearningTask, as_data

Action = npt.NDArray[np.float32]
"""Speeds forward, left and up, and the turn to the left, within -1..1, shape (4,)."""


class LeaderFollowerEnv(gymnasium.Env[Observation, Action]):
    """Learn to follow a leader through a world seen by a corrected depth camera.

    `gymnasium.make("swarm.gym:voxdepth/LeaderFollower-v0", **options)` makes one, which has OpenCV use one thread.
    An episode is a mission from take-off to its outcome, and a step one camera period. Drones that fly by their camera
    hover until its first image is known; blind ones fly from the start. The first observation is made at that time, and
    every later one as long after the capture of an image. Observations are described at `learner.Observation`, actions
    at `learner.Learner`, and rewards at `task.RewardConfig`. An episode is terminated when the learner collided or got
    lost, or the mission succeeded, and truncated when that ended in another way. `info` holds the `seed` of the
    episode, `time_s`, and when it has ended the `outcome`.

    Args:
        learner: Number of the learning drone; None takes the first follower.
        render_mode: `rgb_array`, or None for no pictures.
        recorder: Receives everything that happens, and is closed by who made it; None records nothing. Gray images are
            black if neither the corrector nor the sensor model needs them.
        task: As for `LearningTask.of`. What is unknown or impossible is a `MissionError`.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        *,
        learner: int | None = None,
        render_mode: str | None = None,
        recorder: Recorder | None = None,
        **task: Any,
    ) -> None:
        self.render_mode = checked_render_mode(render_mode)
        cv2.setNumThreads(1)
        self.task = LearningTask.of(**task)
        self._drone = self.task.followers[0] if learner is None else learner
        if self._drone not in self.task.followers:
            raise MissionError(f"a learner must be a follower, one of {list(self.task.followers)}, got {learner}")
        self._spec: EnvSpec | None = None
        self._recorder = recorder or Recorder()
        self._episode: Episode | None = None
        self.metadata = {**type(self).metadata, "render_fps": round(self.task.rig.rate_hz)}
        self.observation_space = observation_space(self.task)
        self.action_space = action_space()

    def __getstate__(self) -> dict[str, Any]:
        """Copy an environment, or send it to another process, between episodes."""
        if self._episode is not None:
            raise MissionError(
                "an environment with an episode cannot be copied or sent to another process: call close() before, or "
                "make one there, as gymnasium.make_vec does"
            )
        return self.__dict__

    def __copy__(self) -> "LeaderFollowerEnv":
        """Return an environment of its own."""
        return deepcopy(self)

    @property
    def spec(self) -> EnvSpec | None:
        """How Gymnasium makes this environment, with options as JSON has them."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = None if spec is None else replace(spec, kwargs=as_data(spec.kwargs))

    @property
    def episode(self) -> Episode:
        """The present episode; without one this is a `MissionError`."""
        if self._episode is None:
            raise MissionError("there is no episode: call reset() first, also after close()")
        return self._episode

    @property
    def mission(self) -> Mission:
        """The mission of the present episode."""
        return self.episode.mission

    @property
    def role(self) -> Role:
        """The role of the learner in its swarm."""
        return self.episode.roles[self._drone]

    def situation(self) -> Situation:
        """Return what the learner knows, as a controller would get it; an expert to learn from may decide on it."""
        return self.episode.situation(self._drone)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a seed; None draws the next one from `np_random`. `options` have no effect.

        The seed is that of the scene and of all noise: the same seed and actions give the same observations, bit for
        bit. A task that cannot be flown is a `MissionError`.
        """
        super().reset(seed=seed)
        drawn = int(self.np_random.integers(2**32)) if seed is None else seed
        self.close()
        self._episode = Episode(self.task, [self._drone], self._recorder, drawn)
        return self._episode.observe(self._drone), self._episode.info()

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly for one camera period, or to the end of the mission, by an action, of which values are clipped to -1..1.

        Without an episode, after its end, or for an unusable action, this is a `MissionError`.
        """
        episode = self.episode
        result = episode.step({self._drone: action})[self._drone]
        return episode.observe(self._drone), *result, episode.info()

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the learner from behind, shape (240, 640, 3), RGB; None without a render mode."""
        return None if self.render_mode is None else self.episode.picture(self._drone)

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
        self._episode = None


def action_space() -> spaces.Space[Action]:
    """Return the space of actions."""
    return spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)


def observation_space(task: LearningTask) -> spaces.Dict:
    """Return the space of `learner.Observation`."""
    max_speed_m_s, lost_m, shape = task.airframe.max_speed_m_s, task.mission.lost_m, task.rig.intrinsics.shape
    depth_m = spaces.Box(0.0, task.rig.max_depth_m, shape, np.float32)
    nearness = spaces.Box(0, 255, (1, *shape), np.uint8)
    gray = {"gray": nearness} if task.gray else {}
    return spaces.Dict(
        {
            **gray,
            **({"depth_m": depth_m} if task.observation == "metres" else {"nearness": nearness}),
            "velocity_m_s": spaces.Box(-max_speed_m_s, max_speed_m_s, (3,), np.float32),
            "leader_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
            "slot_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
        }
    )
