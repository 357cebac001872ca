"""The task of learning: the world, the mission, what is observed, and the reward."""

import json
from collections.abc import Mapping
from functools import reduce
from importlib.metadata import entry_points
from typing import Any, Literal

import pydantic
from pydantic import Field
from pydantic_core import PydanticSerializationError, to_jsonable_python

from sim.bodies import Weather
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from voxdepth.errors import VoxDepthError
from voxdepth.model import Model, changed, explained

from ..config import MissionConfig, MissionSetup
from ..errors import MissionError
from ..rules import RuleWeights
from ..team import FormationConfig, Point, Route

CALM = Weather(shadows=False)
"""Light without shadows, which takes two thirds of the time."""
SMALL_BLOCKS = RigConfig().stereo.model_copy(update={"block_px": 3})
SMALL_RIG = RigConfig(width_px=240, height_px=180, decimate=3, stereo=SMALL_BLOCKS)
RULES = RuleWeights()
SCENARIOS = "voxdepth.scenarios"
"""Group of the entry point that gives the parts of a scenario: this package does not import the testbed's scenarios."""
STREETS = CitySpec(columns=3, rows=6, poles=6, tower_height_m=(9.0, 13.0), weather=CALM)


def pair(start_m: Point, goal_m: Point, **changes: Any) -> MissionConfig:
    """Return the short mission of a leader, at any height, and one follower."""
    return MissionConfig(
        **{
            "drones": 2,
            "routes": (Route(start_m=start_m, goal_m=goal_m),),
            "rules": RuleWeights(min_altitude_m=min(RULES.min_altitude_m, start_m[2]), max_altitude_m=start_m[2]),
            "duration_s": 40.0,
            "control_hz": 10,
            "latency_s": 0.0,
            **changes,
        }
    )


def as_data(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options of a task as tables, lists, texts and numbers, as JSON has them; what else there is stays."""
    data = {}
    for name, value in options.items():
        try:
            data[name] = to_jsonable_python(value)
        except PydanticSerializationError:
            data[name] = value
    return data


def setup_of(scenario: str) -> MissionSetup:
    """Return the parts of a scenario; `mission.latency_s` includes the time of its corrector."""
    for found in entry_points(group=SCENARIOS):
        try:
            setup: MissionSetup = found.load()(scenario)
        except VoxDepthError as error:
            raise MissionError(str(error)) from error
        return setup
    raise MissionError(
        f"the scenario {scenario!r} is of the testbed, which is not installed: `pip install -e '.[sim,gym]'` in a "
        "checkout installs it"
    )


BELOW = FormationConfig(half_width_m=0.1, height_step_m=-11.0)
"""A follower flies below and behind its leader."""
OVER_THE_ROOFS = pair((-8.0, 0.0, 17.0), (36.0, 0.0, 17.0), deadlock_s=10.0, formation=BELOW)


class RewardConfig(Model):
    """Costs and bonuses, the sum of which is the reward of a step of `dt_s`.

        - slot_per_s * min(distance_to_slot_m / slot_scale_m, 1) * dt_s
        + approach_per_m * approach to the slot in this step
        - collision    when the drone is part of a collision
        - lost         when it is farther than `mission.lost_m` from its leader and its slot
        + arrival      when the mission is a success

    The approach (Ng, Harada and Russell 1999, without the discount) cannot be earned by going to and fro.
    """

    slot_per_s: float = Field(default=1.0, ge=0)
    """Cost of a second far from the slot; more of it makes formation matter more than the bonus."""
    slot_scale_m: float = Field(default=8.0, gt=0)
    """Distance from the slot at which the cost saturates; less of it rewards precision and guides less from afar."""
    approach_per_m: float = Field(default=1.0, ge=0)
    collision: float = Field(default=50.0, ge=0)
    lost: float = Field(default=50.0, ge=0)
    arrival: float = Field(default=10.0, ge=0)


class LearningTask(MissionSetup):
    """Everything that an episode depends on besides its seed and the actions.

    By default a drone follows through the streets a leader that flies over the roofs, so that its way tells nothing of
    what stands there.
    """

    scene: AnyScene = STREETS
    mission: MissionConfig = OVER_THE_ROOFS
    """The mission without its `aftermath_s`: an episode ends with the first collision. Its `latency_s` is the simulated
    time from a capture until its corrected depth can be observed."""
    rig: RigConfig = SMALL_RIG
    """The cameras; a step lasts one period of theirs."""
    others: Literal["blind", "same"] = "blind"
    """Drones that do not learn: `blind` ones have no camera and see each other by radio alone, so that their way must
    be free, and with `same` they have the eyes of the learner and the controller of the mission."""
    observation: Literal["metres", "nearness"] = "metres"
    """The depth in metres, or its nearness as an image for convolutions."""
    gray: bool = False
    """Whether the gray image is observed beside the depth."""
    reward: RewardConfig = RewardConfig()

    @classmethod
    def of(cls, scenario: str | None = None, depth: str | None = None, **fields: Any) -> "LearningTask":
        """Create a task from fields by name, of which tables change single keys, and the `depth` of the rig.

        The parts of a scenario, a shipped one by name or a file, take the places of the defaults, and all drones have
        the same eyes. What is unknown or impossible is a `MissionError`.
        """
        changes = [as_data(fields), {} if depth is None else {"rig": {"depth": depth}}]
        if scenario is not None:
            changes.insert(0, {**setup_of(scenario).model_dump(mode="json"), "others": "same"})
        with explained(cls, MissionError):  # As JSON, in which a list may stand for a tuple.
            return cls.model_validate_json(
                json.dumps(reduce(changed, changes, cls().model_dump(mode="json")), default=repr)
            )

    @pydantic.field_validator("mission")
    @classmethod
    def _require_followers(cls, mission: MissionConfig) -> MissionConfig:
        if mission.drones < 2:
            raise ValueError(f"only followers learn, so drones must be 2 or more, got {mission.drones}")
        return mission

    @property
    def followers(self) -> tuple[int, ...]:
        """Numbers of the drones that may learn: all except the leaders."""
        return tuple(drone for team in self.mission.teams() for drone in team.members[1:])
