"""One mission in which a follower is steered from outside, image by image."""

from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sim.world import World
from voxdepth.types import FloatArray

from ..agents import create_agent
from ..compose import composed_mission
from ..config import MissionConfig
from ..controllers import Agent, Role, load_controller
from ..errors import MissionError
from ..pilot import Situation
from ..recorder import Recorder
from ..types import Outcome
from ..vectors import length
from .learner import ACTION_SIZE, Learner, Observation, observe
from .task import LearningTask


class StepResult(NamedTuple):
    """Reward of a step, and whether the episode is over."""

    reward: float
    terminated: bool
    """The learner collided or got lost, or its mission succeeded."""
    truncated: bool
    """The mission ended in another way: time ran out, nobody made progress, or another drone collided or got lost."""


class Episode:
    """A mission from take-off to its outcome; a step lasts one camera period.

    All drones hover until the first image is known, as drones with a controller do. The first observation is made at
    that time, and every later one as long after the capture of an image.

    Args:
        task: World, mission and reward.
        learner: Number of the follower that is steered from outside.
        seed: Seed of the scene and of all noise: the same seed and actions give the same observations, bit for bit.
        recorder: Receives everything that happens, and is closed with the episode; None records nothing.

    Raises:
        MissionError: The learner is no follower of the task, or the task cannot be flown.
    """

    def __init__(self, task: LearningTask, learner: int, *, seed: int, recorder: Recorder | None = None) -> None:
        task.require_follower(learner)
        self.seed = seed
        self._config = task.mission.model_copy(update={"aftermath_s": 0.0, "after_contact": "end"})
        self._task = task.model_copy(update={"mission": self._config})
        self._drone = learner
        self._ticks_per_step = round(self._config.control_hz / task.rig.rate_hz)
        self._resources = ExitStack()
        recorder = recorder or Recorder()
        self._resources.callback(recorder.close)
        everyone = range(self._config.drones * len(self._config.routes))
        mission = composed_mission(
            self._task, recorder, latency_s=task.latency_s, seed=seed, gray=False, make_agent=self._create_agent,
            blind=[drone for drone in everyone if task.others == "blind" and drone != learner], measured=False,
        )  # fmt: skip
        try:
            self._mission = self._resources.enter_context(mission)
            self.world: World = self._mission.world
            self._await_first_image()
            self._slot_m = self._distances_m()[1]
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

    def situation(self) -> Situation:
        """Return what the learner knows, as a controller would get it; an expert to learn from may decide on it."""
        return self._mission.situation(self._drone)

    def observe(self) -> Observation:
        """Return the observation of the learner."""
        return observe(self.situation(), self.role, self._task)

    def step(self, action: npt.ArrayLike) -> StepResult:
        """Fly one camera period, or to the end of the mission, by an action of shape (4,).

        Values beyond -1..1 are clipped. If the episode is over, or the action is unusable, this is a `MissionError`.
        """
        if self.outcome is not None:
            raise MissionError(f"the episode has ended with {self.outcome.value!r}; call reset() to begin another one")
        self._learner.action = clipped_action(action)
        ticks = 0
        while ticks < self._ticks_per_step and self.outcome is None:
            self._mission.tick()
            ticks += 1
        return self._result(ticks / self._config.control_hz)

    def _result(self, dt_s: float) -> StepResult:
        """Evaluate the last step, which took the simulated time `dt_s`, by the true positions."""
        c, outcome = self._task.reward, self.outcome
        leader_m, slot_m = self._distances_m()
        approach_m, self._slot_m = self._slot_m - slot_m, slot_m
        reward = c.approach_per_m * approach_m - c.slot_per_s * min(slot_m / c.slot_scale_m, 1.0) * dt_s
        if outcome is None:
            return StepResult(reward, terminated=False, truncated=False)
        collided = outcome is Outcome.COLLISION and any(self._drone in hit.drones for hit in self.world.contacts)
        lost = outcome is Outcome.LOST and min(leader_m, slot_m) > self._config.lost_m
        arrived = outcome is Outcome.SUCCESS
        reward += c.arrival * arrived - c.collision * collided - c.lost * lost
        terminated = collided or lost or arrived
        return StepResult(reward, terminated, truncated=not terminated)

    def _distances_m(self) -> tuple[float, float]:
        """True distances of the learner from its leader and from its slot."""
        states, role = self.world.states, self.role
        from_leader_m = states[role.drone].position_m - states[role.team.leader].position_m
        return length(from_leader_m), length(from_leader_m - role.offset_m)

    def _create_agent(self, role: Role, config: MissionConfig) -> Agent:
        """Create the learner, or the agent of another drone."""
        if role.drone == self._drone:
            self.role, self._learner = role, Learner(role, config)
            return self._learner
        if self._task.others == "same":
            return load_controller(config.controller)(role, config)
        rules = config.rules.model_copy(update={"avoidance": False})
        return create_agent(role, config.model_copy(update={"rules": rules}))

    def _await_first_image(self) -> None:
        while self.situation().percept is None:
            self._mission.tick()
            if self.outcome is not None:
                remedy = "shorten mission.latency_s or corrector_latency_s, or move the starts apart"
                ended = f"the mission ended with {self.outcome.value!r} before the first image was known"
                raise MissionError(f"{ended}: {remedy}")


def clipped_action(action: npt.ArrayLike) -> FloatArray:
    """Return an action, clipped to -1..1; a shape other than (4,) or a value that is not finite is a `MissionError`."""
    given = np.asarray(action)
    if given.dtype.kind not in "fiu" or given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        expected = "four finite numbers (forward, left, up, turn to the left), in an array of shape (4,)"
        raise MissionError(f"an action must be {expected}, got {given.tolist()!r} of shape {given.shape}")
    return np.clip(given.astype(np.float64), -1, 1)
