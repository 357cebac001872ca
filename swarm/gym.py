"""Importing this module registers the environments with Gymnasium, each a task for `LeaderFollowerEnv`.

`gymnasium.make("swarm.gym:" + ID)` always finds them, `"swarm:" + ID` if Gymnasium was imported before `swarm`. The
options of a task are a dictionary, so that `parallel_env(**GAP)` is the same task for PettingZoo.
"""

from typing import Any

import gymnasium

from sim.bodies import Weather, WindConfig
from sim.scenes import CitySpec, GapSpec, LawnSpec

from .environments.task import CALM, SHORT_MISSION
from .rules import RuleWeights
from .task import MissionConfig
from .team import FormationConfig, Route


def _pair(start_m: tuple[float, float, float], goal_m: tuple[float, float, float], **changes: Any) -> MissionConfig:
    """The mission of a leader, at any height, and one follower."""
    route, rules = Route(start_m=start_m, goal_m=goal_m), RuleWeights(max_altitude_m=start_m[2])
    return SHORT_MISSION.model_copy(update={"drones": 2, "routes": (route,), "rules": rules, **changes})


HOVER = {
    "scene": LawnSpec(
        trees=0, weather=Weather(shadows=False, wind=WindConfig(mean_m_s=(10.0, 6.0, 0.0), gust_m_s=4.0))
    ),
    "mission": _pair((0.0, 0.0, 6.0), (0.1, 0.0, 6.0), goal_radius_m=0.01, duration_s=10.0),
}
"""Stay in the slot behind a leader that holds its place, in wind and gusts, until the time is over."""
GAP = {
    "scene": GapSpec(walls=1, gap_m=4.0, spacing_m=10.0, shift_m=4.0, posts=0, height_m=10.0, weather=CALM),
    "mission": _pair(
        (-4.0, 0.0, 14.0), (20.0, 0.0, 14.0), duration_s=20.0,
        formation=FormationConfig(half_width_m=0.1, height_step_m=-9.0),
    ),
}  # fmt: skip
"""Find the gap in a wall that the leader flies over."""
STREETS = {
    "scene": CitySpec(columns=3, rows=6, poles=6, tower_height_m=(9.0, 13.0), weather=CALM),
    "mission": _pair(
        (-8.0, 0.0, 17.0), (36.0, 0.0, 17.0), deadlock_s=10.0,
        formation=FormationConfig(half_width_m=0.1, height_step_m=-11.0),
    ),
}  # fmt: skip
"""Follow through the streets a leader that flies over the roofs, so that its way tells nothing of what stands there."""

ID = "voxdepth/LeaderFollower-v0"
TASKS: dict[str, dict[str, Any]] = {
    ID: {},
    "voxdepth/Hover-v0": HOVER,
    "voxdepth/Gap-v0": GAP,
    "voxdepth/Streets-v0": STREETS,
}

for name, task in TASKS.items():
    gymnasium.register(
        id=name,
        entry_point="swarm.environments.gym_env:LeaderFollowerEnv",
        vector_entry_point="swarm.environments.gym_env:vector_env",
        kwargs=task,
    )
