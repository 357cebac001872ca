"""A PettingZoo environment: all followers learn at once, behind leaders that the mission's controller flies."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from ..errors import MissionError
from .gym_env import Action, action_space, observation_space
from .learner import Observation
from .task import LearningTask
from .view import RENDER_MODES, EpisodeView, Image


class FollowersEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """Learn to follow a leader, all followers of all swarms together.

    Agents are called `drone_1`, `drone_2` and so on, by the number of the drone. Options, observations, actions,
    rewards and infos of each are those of `LeaderFollowerEnv`. An episode ends for all of them at once.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012
        "name": "voxdepth_followers_v0",
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(self, *, render_mode: str | None = None, **task: Any) -> None:
        self._task = LearningTask.of(**task)
        self._view = EpisodeView(self._task, render_mode)
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(self._task.rig.rate_hz)}
        self._drone_of = {f"drone_{drone}": drone for drone in self._task.followers}
        self.possible_agents = list(self._drone_of)
        self.agents: list[str] = []
        self._spaces = {agent: (observation_space(self._task), action_space()) for agent in self._drone_of}
        self._np_random: np.random.Generator | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the observation space of one agent, always the same object."""
        return self._spaces[agent][0]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the action space of one agent, always the same object."""
        return self._spaces[agent][1]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode with a seed; None draws the next one, so that episodes differ. `options` have no effect."""
        if seed is not None or self._np_random is None:
            self._np_random, _ = seeding.np_random(seed)
        episode = self._view.begin(self._task.followers, int(self._np_random.integers(2**32)) if seed is None else seed)
        self.agents = list(self.possible_agents)
        return self._observations(), {agent: episode.info() for agent in self.agents}

    def step(
        self, actions: Mapping[str, Action]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly for one camera period; without an episode, or an action of each agent, this is a `MissionError`."""
        episode, drone_of = self._view.episode, self._drone_of
        if set(actions) != set(drone_of):
            raise MissionError(f"expected an action for each of {self.possible_agents}, got them for {sorted(actions)}")
        results = episode.step({drone_of[agent]: action for agent, action in actions.items()})
        self.agents = [] if episode.outcome is not None else self.agents
        return (
            self._observations(),
            {agent: results[drone].reward for agent, drone in drone_of.items()},
            {agent: results[drone].terminated for agent, drone in drone_of.items()},
            {agent: results[drone].truncated for agent, drone in drone_of.items()},
            {agent: episode.info() for agent in drone_of},
        )

    def render(self) -> Image | None:
        """Return the picture of the first agent, shape (H, W, 3), RGB; None without a render mode."""
        return self._view.render()

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._view.close()
        self.agents = []

    def _observations(self) -> dict[str, Observation]:
        return {agent: self._view.episode.observe(drone) for agent, drone in self._drone_of.items()}


parallel_env = FollowersEnv
"""The name that PettingZoo's tools expect."""
