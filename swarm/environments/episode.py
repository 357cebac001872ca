"""One mission in which some drones are steered from outside, image by image; both environments are made of it."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sim.world import World
from voxdepth.types import FloatArray

from ..compose import composed_mission
from ..controllers import Agent, Role, load_controller
from ..errors import MissionError
from ..pilot import Situation
from ..recorder import Recorder
from ..task import MissionConfig
from ..types import Outcome
from .learner import ACTION_SIZE, Learner, Observation, ShieldedLearner, observe
from .task import LearningTask


@dataclass(frozen=True, kw_only=True)
class StepResult:
    """Reward of one drone for a step, and whether its episode is over."""

    reward: float
    terminated: bool
    """The drone collided or got lost, or its mission succeeded."""
    truncated: bool
    """The mission ended in another way: time ran out, nobody made progress, or another drone collided or got lost."""


class Episode:
    """A mission from take-off to its outcome; a step lasts one camera period.

    All drones hover until the first image is known, as drones with a controller do. The first observation is made at
    that time, and every later one as long after the capture of an image.

    Args:
        task: World, mission and reward.
        learners: Numbers of the followers that are steered from outside.
        seed: Seed of the scene and of all noise: the same seed and actions give the same observations, bit for bit.
        recorder: Receives everything that happens, gray images included; None records nothing.

    Raises:
        MissionError: A learner is no follower of the task, or the task cannot be flown.
    """

    def __init__(
        self, task: LearningTask, learners: Sequence[int], *, seed: int, recorder: Recorder | None = None
    ) -> None:
        require_followers(task, learners)
        self.seed = seed
        config = task.mission.model_copy(update={"aftermath_s": 0.0, "after_contact": "end"})
        self._task = task.model_copy(update={"mission": config})
        self._roles: dict[int, Role] = {}
        self._learners: dict[int, Learner] = {}
        self._learning = frozenset(learners)
        self._ticks_per_step = round(config.control_hz / task.rig.rate_hz)
        self._resources = ExitStack()
        recorded, recorder = recorder is not None, recorder or Recorder()
        everyone = {drone for team in config.teams() for drone in team.members}
        guided = everyone - self._learning if task.others == "truth" else ()
        mission = composed_mission(
            self._task, recorder, latency_s=task.latency_s, seed=seed, gray=recorded,
            make_agent=self._create_agent, guided=guided,
        )  # fmt: skip
        try:
            self._mission = self._resources.enter_context(mission)
            self._await_first_image()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._resources.close()

    @property
    def world(self) -> World:
        """The world of the mission."""
        return self._mission.world

    @property
    def outcome(self) -> Outcome | None:
        """Outcome of the mission; None while it goes on."""
        return self._mission.outcome

    def info(self) -> dict[str, Any]:
        """Return the seed, the simulated time and the outcome if there is one, and nothing else of the truth."""
        ended = {} if self.outcome is None else {"outcome": self.outcome.value}
        return {"seed": self.seed, "time_s": self._mission.time_s, **ended}

    def situation(self, drone: int) -> Situation:
        """Return what a drone knows, as a controller would get it; an expert to learn from may decide on it."""
        return self._mission.situation(drone)

    def observe(self, drone: int) -> Observation:
        """Return the observation of a learner."""
        return observe(self.situation(drone), self._roles[drone], self._task)

    def step(self, actions: Mapping[int, npt.ArrayLike]) -> dict[int, StepResult]:
        """Fly one camera period, or to the end of the mission if that comes first.

        There is one action for each learner, of shape (4,); values beyond -1..1 are clipped.

        Raises:
            MissionError: The episode is over, or an action is unusable.
        """
        if self.outcome is not None:
            raise MissionError(f"the episode has ended with {self.outcome.value!r}; call reset() to begin another one")
        for drone, learner in self._learners.items():
            learner.action = clipped_action(actions[drone])
        ticks = 0
        while ticks < self._ticks_per_step and self.outcome is None:
            self._mission.tick()
            ticks += 1
        dt_s = ticks / self._task.mission.control_hz
        return {drone: self._result(self._roles[drone], dt_s) for drone in self._learners}

    def _result(self, role: Role, dt_s: float) -> StepResult:
        """Evaluate the last step of one drone, which took the simulated time `dt_s`, by the true positions."""
        c, states, outcome = self._task.reward, self.world.states, self.outcome
        from_leader_m = states[role.drone].position_m - states[role.team.leader].position_m
        slot_error_m = float(np.linalg.norm(from_leader_m - role.offset_m))
        reward = -c.slot_per_s * min(slot_error_m / c.slot_scale_m, 1.0) * dt_s
        if outcome is None:
            return StepResult(reward=reward, terminated=False, truncated=False)
        collided = outcome is Outcome.COLLISION and any(role.drone in hit.drones for hit in self.world.contacts)
        stray_m = min(float(np.linalg.norm(from_leader_m)), slot_error_m)
        lost = outcome is Outcome.LOST and stray_m > self._task.mission.lost_m
        arrived = outcome is Outcome.SUCCESS
        reward += c.arrival * arrived - c.collision * collided - c.lost * lost
        terminated = collided or lost or arrived
        return StepResult(reward=reward, terminated=terminated, truncated=not terminated)

    def _create_agent(self, role: Role, config: MissionConfig) -> Agent:
        """Create a learner for a learning drone, and the agent of the mission's controller for any other."""
        self._roles[role.drone] = role
        if role.drone not in self._learning:
            return load_controller(config.controller)(role, config)
        create = ShieldedLearner if self._task.steering == "shielded" else Learner
        self._learners[role.drone] = create(role, config)
        return self._learners[role.drone]

    def _await_first_image(self) -> None:
        while any(self.situation(drone).percept is None for drone in self._learners):
            self._mission.tick()
            if self.outcome is not None:
                raise MissionError(
                    f"the mission ended with {self.outcome.value!r} before the first image was known: shorten "
                    "mission.latency_s or corrector_latency_s, or move the starts apart"
                )


def require_followers(task: LearningTask, drones: Sequence[int]) -> None:
    """Require that all learners are followers; another one is a `MissionError`."""
    for drone in drones:
        if drone not in task.followers:
            raise MissionError(f"a learner must be a follower, one of {list(task.followers)}, got {drone}")


def clipped_action(action: npt.ArrayLike) -> FloatArray:
    """Return an action, clipped to -1..1; a shape other than (4,) or a value that is not finite is a `MissionError`."""
    given = np.asarray(action, np.float64)
    if given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        raise MissionError(
            "an action must be four finite numbers within -1..1 (forward, left, up, turn to the left), got "
            f"{given.tolist()}"
        )
    return np.clip(given, -1, 1)
