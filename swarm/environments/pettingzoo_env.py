"""A PettingZoo environment: all followers learn at once, behind leaders that the mission's controller flies."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from ..errors import MissionError
from .episode import Episode
from .gym_env import Action, action_space, observation_space
from .learner import Observation
from .task import LearningTask
from .view import RENDER_MODES, EpisodeView, Image


def parallel_env(**options: Any) -> "FollowersEnv":
    """Create the environment, under the name that PettingZoo's tools expect; see `FollowersEnv` for the options."""
    return FollowersEnv(**options)


class FollowersEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """Learn to follow a leader, all followers of all swarms together.

    Agents are called `drone_1`, `drone_2` and so on, by the number of the drone. Observations, actions, rewards and
    infos of each are those of `LeaderFollowerEnv`. An episode ends for all of them at once, with the mission.

    Args:
        render_mode: `rgb_array`, or None for no pictures.
        task: As those of `LeaderFollowerEnv`.

    Raises:
        MissionError: There is no such render mode, or a field of the task is unknown or impossible.
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
        self._observation_spaces = {agent: observation_space(self._task) for agent in self._drone_of}
        self._action_spaces = {agent: action_space() for agent in self._drone_of}
        self._np_random: np.random.Generator | None = None

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the observation space of one agent, always the same object."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the action space of one agent, always the same object."""
        return self._action_spaces[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode with a seed; None draws the next one, so that episodes differ. `options` have no effect."""
        if seed is not None or self._np_random is None:
            self._np_random, _ = seeding.np_random(seed)
        episode_seed = int(self._np_random.integers(2**32)) if seed is None else seed
        episode = self._view.begin(self._task.followers, episode_seed)
        self.agents = list(self.possible_agents)
        return self._observations(episode), {agent: episode.info() for agent in self.agents}

    def step(
        self, actions: Mapping[str, Action]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Fly for one camera period; return observations, rewards, terminated, truncated and infos by agent.

        Raises:
            MissionError: There is no episode, it is over, or an action is missing or unusable.
        """
        episode = self._view.episode
        if set(actions) != set(self._drone_of):
            raise MissionError(f"expected an action for each of {self.possible_agents}, got them for {sorted(actions)}")
        by_drone = episode.step({self._drone_of[agent]: action for agent, action in actions.items()})
        results = {agent: by_drone[drone] for agent, drone in self._drone_of.items()}
        self.agents = [] if episode.outcome is not None else self.agents
        return (
            self._observations(episode),
            {agent: result.reward for agent, result in results.items()},
            {agent: result.terminated for agent, result in results.items()},
            {agent: result.truncated for agent, result in results.items()},
            {agent: episode.info() for agent in results},
        )

    def render(self) -> Image | None:
        """Return the image of the first agent over a map, shape (H, W, 3), RGB; None without a render mode."""
        return self._view.render()

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._view.close()
        self.agents = []

    def _observations(self, episode: Episode) -> dict[str, Observation]:
        return {agent: episode.observe(drone) for agent, drone in self._drone_of.items()}
