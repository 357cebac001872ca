"""A small task for environments, quick to fly."""

from typing import Any

from sim.scenes import CitySpec
from sim.sensor import RigConfig
from swarm.config import MissionConfig
from swarm.environments.task import LearningTask, RewardConfig
from swarm.team import Route

QUICK_CITY = CitySpec(columns=1, rows=2, poles=0)
QUICK_RIG = RigConfig(width_px=48, height_px=32, depth="truth")
HOVER = [0.0, 0.0, 0.0, 0.0]
FORWARD = [1.0, 0.0, 0.0, 0.0]
DIVE = [0.0, 0.0, -1.0, 0.0]
TURN = [0.0, 0.0, 0.0, 1.0]


def quick(*, x_m: float = -2.0, y_m: float = 0.0, others: str = "same", **mission: Any) -> dict[str, Any]:
    """Options of an environment: three drones that fly along x to a goal before the first towers, by exact depth."""
    route = Route(start_m=(-8.0, y_m, 6.0), goal_m=(x_m, y_m, 6.0))
    values: dict[str, Any] = {"drones": 3, "duration_s": 12.0, "routes": (route,)}
    return {
        "scene": QUICK_CITY,
        "rig": QUICK_RIG,
        "corrector": "raw",
        "mission": MissionConfig(**values | mission),
        "others": others,
        "reward": RewardConfig(approach_per_m=0.0),
    }


def quick_task(**options: Any) -> LearningTask:
    """The same as a task."""
    return LearningTask(**quick(**options))
