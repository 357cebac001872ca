"""One mission in which some drones are steered from outside, image by image: what both environments are made of."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from sim.render import create_renderer
from sim.rig import StereoRig
from sim.world import World
from voxdepth.types import FloatArray

from ..controllers import Agent, Role, load_controller
from ..errors import MissionError
from ..mission import Mission, start_yaws_rad, starts_m
from ..pilot import Situation
from ..recorder import NullRecorder, Recorder
from ..task import MissionConfig
from ..types import Outcome
from .observation import Limits, Observation, observe
from .reward import Referee, Verdict
from .steering import ACTION_SIZE, Learner, create_learner
from .task import LearningTask


class Episode:
    """A mission from take-off to its outcome; a step lasts one camera period.

    All drones hover until the first image is known to them, as scripted ones do anyway; there the first observation is
    made. From then on every observation is made that long after an image was taken.

    Args:
        task: What is flown.
        learners: Numbers of the followers that are steered from outside.
        seed: Of the scene and of all noise: the same seed and actions give the same observations, bit for bit.
        recorder: Told of everything, gray images included; None if nobody is.

    Raises:
        MissionError: A learner is no follower of the task, or the task cannot be flown.
    """

    def __init__(
        self, task: LearningTask, learners: Sequence[int], *, seed: int, recorder: Recorder | None = None
    ) -> None:
        require_followers(task, learners)
        self.seed = seed
        self._task = task
        self._roles: dict[int, Role] = {}
        self._learners: dict[int, Learner] = {}
        self._wanted = frozenset(learners)
        self._limits = limits_of(task)
        config = task.mission.model_copy(update={"aftermath_s": 0.0})
        self._ticks_per_step = round(config.control_hz / task.rig.rate_hz)
        self._control_hz = config.control_hz
        self.world = World(
            task.scene.build(seed), starts_m(config), task.airframe, start_yaw_rad=start_yaws_rad(config)
        )
        try:
            self._mission = self._new_mission(config, recorder or NullRecorder(), gray=recorder is not None)
            self._referee = Referee(task.reward, config, self.world)
            self._await_first_image()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self.world.close()

    @property
    def outcome(self) -> Outcome | None:
        """Of the mission; None while it goes on."""
        return self._mission.outcome

    def info(self) -> dict[str, Any]:
        """The seed and the simulated time, and the outcome once there is one; nothing of the truth beyond that."""
        ended = {} if self.outcome is None else {"outcome": self.outcome.value}
        return {"seed": self.seed, "time_s": self._mission.time_s, **ended}

    def situation(self, drone: int) -> Situation:
        """All that a drone knows now, as the rules would be given it; an expert to learn from may decide on it."""
        return self._mission.situation(drone)

    def observe(self, drone: int) -> Observation:
        """What a learner is shown of that."""
        return observe(self.situation(drone), self._roles[drone], self._limits)

    def step(self, actions: Mapping[int, npt.ArrayLike]) -> dict[int, Verdict]:
        """Fly one camera period, or to the end of the mission if that comes first.

        Args:
            actions: One for each learner, of shape (4,) and within -1..1; what is beyond is clipped.

        Returns:
            The verdict on each learner.

        Raises:
            MissionError: The episode is over, or an action is unusable.
        """
        if self.outcome is not None:
            raise MissionError(f"the episode has ended with {self.outcome.value!r}; call reset() to begin another one")
        for drone, learner in self._learners.items():
            learner.action = checked(actions[drone])
        ticks = 0
        while ticks < self._ticks_per_step and self.outcome is None:
            self._mission.tick()
            ticks += 1
        step_s = ticks / self._control_hz
        return {drone: self._referee.verdict(self._roles[drone], self.outcome, step_s) for drone in self._learners}

    def _new_mission(self, config: MissionConfig, recorder: Recorder, *, gray: bool) -> Mission:
        task, world = self._task, self.world
        correctors = [task.corrector.create(task.rig.intrinsics) for _ in range(world.n_drones)]
        gray = gray or any(corrector.uses_gray for corrector in correctors)
        renderer = create_renderer(task.renderer, world, threads=1)
        return Mission(
            config,
            world,
            StereoRig(world, renderer, task.rig, seed=self.seed, gray=gray),
            correctors,
            recorder,
            camera_hz=task.rig.rate_hz,
            latency_s=task.latency_s,
            seed=self.seed,
            make_agent=self._make_agent,
        )

    def _make_agent(self, role: Role, config: MissionConfig) -> Agent:
        """A learner where one is wanted, and elsewhere what the mission asks for."""
        self._roles[role.drone] = role
        if role.drone not in self._wanted:
            return load_controller(config.controller)(role, config)
        self._learners[role.drone] = create_learner(self._task.steering, role, config)
        return self._learners[role.drone]

    def _await_first_image(self) -> None:
        while any(self.situation(drone).percept is None for drone in self._learners):
            self._mission.tick()
            if self.outcome is not None:
                raise MissionError(
                    f"the mission ended with {self.outcome.value!r} before the first image was known: shorten "
                    "mission.latency_s or corrector_latency_s, or move the starts apart"
                )


def limits_of(task: LearningTask) -> Limits:
    """The limits of what can be observed in a task."""
    return Limits(depth_m=task.rig.max_depth_m, speed_m_s=task.airframe.max_speed_m_s, distance_m=task.mission.lost_m)


def require_followers(task: LearningTask, drones: Sequence[int]) -> None:
    """Refuse to let others than followers learn.

    Raises:
        MissionError: One of them is no follower of the task.
    """
    for drone in drones:
        if drone not in task.followers:
            raise MissionError(f"a learner must be a follower, one of {list(task.followers)}, got {drone}")


def checked(action: npt.ArrayLike) -> FloatArray:
    """An action as shape (4,), clipped to -1..1.

    Raises:
        MissionError: It has another shape, or is not finite.
    """
    given = np.asarray(action, np.float64)
    if given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        raise MissionError(
            "an action must be four finite numbers within -1..1 (forward, left, up, turn to the left), got "
            f"{given.tolist()}"
        )
    return np.clip(given, -1, 1)


def running(episode: Episode | None) -> Episode:
    """The episode that there must be.

    Raises:
        MissionError: There is none.
    """
    if episode is None:
        raise MissionError("there is no episode: call reset() first, also after close()")
    return episode
