"""One mission in which some drones are steered from outside, image by image; both environments are made of it."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

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
from ..vectors import length
from .learner import ACTION_SIZE, Learner, Observation, observe
from .task import LearningTask


class StepResult(NamedTuple):
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
        recorder: Receives everything that happens, and is closed with the episode; None records nothing.

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
        self.roles: dict[int, Role] = {}
        """Place of each drone in its swarm."""
        self._learners: dict[int, Learner] = {}
        self._learning = frozenset(learners)
        self._ticks_per_step = round(config.control_hz / task.rig.rate_hz)
        self._resources = ExitStack()
        recorder = recorder or Recorder()
        self._resources.callback(recorder.close)
        everyone = {drone for team in config.teams() for drone in team.members}
        guided = everyone - self._learning if task.others == "truth" else ()
        mission = composed_mission(
            self._task, recorder, latency_s=task.latency_s, seed=seed, gray=recorder.wants_all,
            make_agent=self._create_agent, guided=guided, measured=recorder.wants_all,
        )  # fmt: skip
        try:
            self._mission = self._resources.enter_context(mission)
            self.world: World = self._mission.world
            self._await_first_image()
            self._slot_m = {drone: self._distances_m(role)[1] for drone, role in self.roles.items()}
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._resources.close()

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
        return observe(self.situation(drone), self.roles[drone], self._task)

    def step(self, actions: Mapping[int, npt.ArrayLike]) -> dict[int, StepResult]:
        """Fly one camera period, or to the end of the mission, by an action of shape (4,) for each learner.

        Values beyond -1..1 are clipped. If the episode is over, or an action is unusable, this is a `MissionError`.
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
        return {drone: self._result(self.roles[drone], dt_s) for drone in self._learners}

    def _result(self, role: Role, dt_s: float) -> StepResult:
        """Evaluate the last step of one drone, which took the simulated time `dt_s`, by the true positions."""
        c, outcome = self._task.reward, self.outcome
        leader_m, slot_m = self._distances_m(role)
        approach_m, self._slot_m[role.drone] = self._slot_m[role.drone] - slot_m, slot_m
        reward = c.approach_per_m * approach_m - c.slot_per_s * min(slot_m / c.slot_scale_m, 1.0) * dt_s
        if outcome is None:
            return StepResult(reward, terminated=False, truncated=False)
        collided = outcome is Outcome.COLLISION and any(role.drone in hit.drones for hit in self.world.contacts)
        lost = outcome is Outcome.LOST and min(leader_m, slot_m) > self._task.mission.lost_m
        arrived = outcome is Outcome.SUCCESS
        reward += c.arrival * arrived - c.collision * collided - c.lost * lost
        terminated = collided or lost or arrived
        return StepResult(reward, terminated, truncated=not terminated)

    def _distances_m(self, role: Role) -> tuple[float, float]:
        """True distances of a drone from its leader and from its slot."""
        states = self.world.states
        from_leader_m = states[role.drone].position_m - states[role.team.leader].position_m
        return length(from_leader_m), length(from_leader_m - role.offset_m)

    def _create_agent(self, role: Role, config: MissionConfig) -> Agent:
        """Create a learner for a learning drone, and the agent of the mission's controller for any other."""
        self.roles[role.drone] = role
        if role.drone not in self._learning:
            return load_controller(config.controller)(role, config)
        self._learners[role.drone] = Learner(role, config)
        return self._learners[role.drone]

    def _await_first_image(self) -> None:
        while any(self.situation(drone).percept is None for drone in self._learners):
            self._mission.tick()
            if self.outcome is not None:
                remedy = "shorten mission.latency_s or corrector_latency_s, or move the starts apart"
                ended = f"the mission ended with {self.outcome.value!r} before the first image was known"
                raise MissionError(f"{ended}: {remedy}")


def require_followers(task: LearningTask, drones: Sequence[int]) -> None:
    """Require that all learners are followers; another one is a `MissionError`."""
    for drone in drones:
        if drone not in task.followers:
            raise MissionError(f"a learner must be a follower, one of {list(task.followers)}, got {drone}")


def clipped_action(action: npt.ArrayLike) -> FloatArray:
    """Return an action, clipped to -1..1; a shape other than (4,) or a value that is not finite is a `MissionError`."""
    given = np.asarray(action)
    if given.dtype.kind not in "fiu" or given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        expected = "four finite numbers (forward, left, up, turn to the left), in an array of shape (4,)"
        raise MissionError(f"an action must be {expected}, got {given.tolist()!r} of shape {given.shape}")
    return np.clip(given.astype(np.float64), -1, 1)
