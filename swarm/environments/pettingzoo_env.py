"""A PettingZoo environment: all followers learn together, our controller flies the leaders."""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from ..errors import MissionError
from ..recorder import Recorder
from .episode import RENDER_MODES, Episode, checked_render_mode
from .gym_env import Action, action_space, observation_space
from .learner import Observation
from .task import LearningTask


class FollowersEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """Learn to follow a leader, all followers of all swarms together.

    Agents are called `drone_1`, `drone_2` and so on, by the number of the drone. Observations, actions, rewards and
    infos of each are those of `LeaderFollowerEnv`. An episode ends for all of them at once.

    Args:
        render_mode: `rgb_array`, which shows the first agent, or None for no pictures.
        task: As for `LearningTask.of`. What is unknown or impossible is a `MissionError`.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "voxdepth_followers_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, *, render_mode: str | None = None, **task: Any) -> None:
        self.render_mode = checked_render_mode(render_mode)
        cv2.setNumThreads(1)
        self.task = LearningTask.of(**task)
        self.metadata = {**type(self).metadata, "render_fps": round(self.task.rig.rate_hz)}
        self._drone_of = {f"drone_{drone}": drone for drone in self.task.followers}
        self.possible_agents = list(self._drone_of)
        self.agents: list[str] = []
        self.observation_spaces = {agent: observation_space(self.task) for agent in self.possible_agents}
        self.action_spaces = {agent: action_space() for agent in self.possible_agents}
        self._np_random: np.random.Generator | None = None
        self._episode: Episode | None = None

    def __getstate__(self) -> dict[str, Any]:
        """Copy an environment, or send it to another process, between episodes."""
        if self._episode is not None:
            raise MissionError("an environment with an episode cannot be copied or sent to another process: close() it")
        return self.__dict__

    def __copy__(self) -> "FollowersEnv":
        """Return an environment of its own."""
        return deepcopy(self)

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the observation space of one agent, always the same object."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the action space of one agent, always the same object."""
        return self.action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode with a seed; None draws the next one. `options` have no effect."""
        if seed is not None or self._np_random is None:
            self._np_random, _ = seeding.np_random(seed)
        drawn = int(self._np_random.integers(2**32)) if seed is None else seed
        self.close()
        self._episode = Episode(self.task, self.task.followers, Recorder(), drawn)
        self.agents = list(self.possible_agents)
        return self._observations(), self._infos()

    def step(
        self, actions: Mapping[str, Action]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly for one camera period; without an episode, or an action of each agent, this is a `MissionError`."""
        episode, drone_of = self.episode, self._drone_of
        if set(actions) != set(drone_of):
            raise MissionError(f"expected an action for each of {self.possible_agents}, got them for {sorted(actions)}")
        results = episode.step({drone_of[agent]: action for agent, action in actions.items()})
        self.agents = [] if episode.mission.outcome is not None else self.agents
        return (
            self._observations(),
            {agent: results[drone].reward for agent, drone in drone_of.items()},
            {agent: results[drone].terminated for agent, drone in drone_of.items()},
            {agent: results[drone].truncated for agent, drone in drone_of.items()},
            self._infos(),
        )

    @property
    def episode(self) -> Episode:
        """The present episode; without one this is a `MissionError`."""
        if self._episode is None:
            raise MissionError("there is no episode: call reset() first, also after close()")
        return self._episode

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the first agent from behind, shape (240, 640, 3), RGB; None without a render mode."""
        return None if self.render_mode is None else self.episode.picture(self.task.followers[0])

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        if self._episode is not None:
            self._episode.close()
        self._episode, self.agents = None, []

    def _observations(self) -> dict[str, Observation]:
        return {agent: self.episode.observe(drone) for agent, drone in self._drone_of.items()}

    def _infos(self) -> dict[str, dict[str, Any]]:
        return {agent: self.episode.info() for agent in self._drone_of}


parallel_env = FollowersEnv
"""The name that PettingZoo's tools expect."""
