"""Importing this module registers the environments with Gymnasium, each a task for `LeaderFollowerEnv`.

`gymnasium.make("swarm.gym:" + ID)` imports it.
"""

from typing import Any

import gymnasium

from sim.bodies import Weather, WindConfig
from sim.scenes import LawnSpec

from .environments.task import as_data, pair

HOVER = {
    "scene": LawnSpec(
        trees=0, weather=Weather(shadows=False, wind=WindConfig(mean_m_s=(10.0, 6.0, 0.0), gust_m_s=4.0))
    ),
    "mission": pair((0.0, 0.0, 6.0), (0.1, 0.0, 6.0), goal_radius_m=0.01, duration_s=10.0),
}
"""Stay in the slot behind a leader that holds its place, in wind and gusts, until the time is over."""

ID = "voxdepth/LeaderFollower-v0"
TASKS: dict[str, dict[str, Any]] = {ID: {}, "voxdepth/Hover-v0": HOVER}

for name, task in TASKS.items():
    gymnasium.register(id=name, entry_point="swarm.environments.gym_env:LeaderFollowerEnv", kwargs=as_data(task))
