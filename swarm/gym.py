"""Importing this module registers the environments with Gymnasium, each a task for `LeaderFollowerEnv`.

`gymnasium.make("swarm.gym:" + ID)` imports it.
"""

from typing import Any

import gymnasium

from sim.bodies import Weather, WindConfig
from sim.scenes import GapSpec, LawnSpec

from .environments.task import CALM, below_by, pair

HOVER = {
    "scene": LawnSpec(
        trees=0, weather=Weather(shadows=False, wind=WindConfig(mean_m_s=(10.0, 6.0, 0.0), gust_m_s=4.0))
    ),
    "mission": pair((0.0, 0.0, 6.0), (0.1, 0.0, 6.0), goal_radius_m=0.01, duration_s=10.0),
}
"""Stay in the slot behind a leader that holds its place, in wind and gusts, until the time is over."""
GAP = {
    "scene": GapSpec(walls=1, gap_m=4.0, spacing_m=10.0, shift_m=4.0, posts=0, height_m=10.0, weather=CALM),
    "mission": pair((-4.0, 0.0, 14.0), (20.0, 0.0, 14.0), duration_s=20.0, formation=below_by(9.0)),
}
"""Find the gap in a wall that the leader flies over."""

ID = "voxdepth/LeaderFollower-v0"
TASKS: dict[str, dict[str, Any]] = {ID: {}, "voxdepth/Hover-v0": HOVER, "voxdepth/Gap-v0": GAP}

for name, task in TASKS.items():
    gymnasium.register(id=name, entry_point="swarm.environments.gym_env:LeaderFollowerEnv", kwargs=task)
