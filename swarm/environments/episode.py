"""One mission in which some followers are steered from outside, camera period by camera period."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from sim import frames
from sim.render import create_renderer
from sim.types import Camera, Renderer
from voxdepth.arithmetic import length, matmul
from voxdepth.types import FloatArray, Intrinsics

from ..agents import create_agent
from ..compose import composed_mission
from ..config import MissionConfig
from ..controllers import Agent, Role, load_controller
from ..errors import MissionError
from ..pilot import Situation
from ..recorder import Recorder
from ..types import Outcome
from .learner import ACTION_SIZE, Learner, Observation, observe
from .task import LearningTask

RENDER_MODES = ("rgb_array",)
PICTURE = Intrinsics.from_hfov(width_px=640, height_px=240, hfov_deg=100.0)
"""Camera that takes the pictures of a learner."""
BEHIND_M = np.array([0.0, -1.2, -4.0])
"""From the camera of a learner to that behind it, in its frame: x right, y down, z forward."""


class StepResult(NamedTuple):
    """Reward of one learner for a step, and whether its episode is over."""

    reward: float
    terminated: bool
    """The learner collided or got lost, or the mission succeeded."""
    truncated: bool
    """The mission ended in another way."""


class Episode:
    """A mission from take-off to its outcome, which ends with the first collision.

    Args:
        task: World, mission and reward.
        learners: Numbers of the followers that are steered.
        recorder: Receives everything that happens; the caller closes it.
        seed: Seed of the scene and of all noise.

    Raises:
        MissionError: The task cannot be flown, or its mission ends before the first image is known.
    """

    def __init__(self, task: LearningTask, learners: Sequence[int], recorder: Recorder, seed: int) -> None:
        config = task.mission.model_copy(update={"aftermath_s": 0.0, "after_contact": "end"})
        self._task, self._seed, self._learners = task, seed, tuple(learners)
        self.roles: dict[int, Role] = {}
        """Role of each learner in its swarm."""
        self._agents: dict[int, Learner] = {}
        self._renderer: Renderer | None = None
        everyone = range(config.drones * len(config.routes))
        composed = composed_mission(
            task.model_copy(update={"mission": config}),
            recorder,
            latency_s=config.latency_s,
            seed=seed,
            gray=task.gray,
            make_agent=self._create_agent,
            blind=[drone for drone in everyone if task.others == "blind" and drone not in self._learners],
            measured=False,
        )
        with ExitStack() as resources:
            self.mission = resources.enter_context(composed)
            self._await_first_images()
            self._resources = resources.pop_all()
        self._slot_m = {drone: self._distances_m(drone)[1] for drone in self._learners}

    def close(self) -> None:
        """Free the world."""
        self._resources.close()

    def situation(self, drone: int) -> Situation:
        """Return what a drone knows, as a controller would get it."""
        return self.mission.situation(drone)

    def observe(self, drone: int) -> Observation:
        """Return the observation of a learner."""
        return observe(self.situation(drone), self.roles[drone], self._task)

    def info(self) -> dict[str, Any]:
        """Return the seed, the simulated time and the outcome if there is one, and nothing else of the truth."""
        outcome = self.mission.outcome
        ended = {} if outcome is None else {"outcome": outcome.value}
        return {"seed": self._seed, "time_s": self.mission.time_s, **ended}

    def step(self, actions: Mapping[int, npt.ArrayLike]) -> dict[int, StepResult]:
        """Fly for one camera period, or to the end of the mission, by an action of shape (4,) for each learner.

        After the end, or for an unusable action, this is a `MissionError`.
        """
        mission = self.mission
        if mission.outcome is not None:
            ended = f"the episode has ended with {mission.outcome.value!r}"
            raise MissionError(f"{ended}; call reset() to begin another one")
        clipped = {drone: clipped_action(action) for drone, action in actions.items()}
        for drone, action in clipped.items():
            self._agents[drone].action = action
        control_hz, ticks = self._task.mission.control_hz, 0
        while ticks < round(control_hz / self._task.rig.rate_hz) and mission.outcome is None:
            mission.tick()
            ticks += 1
        return {drone: self._result(drone, ticks / control_hz) for drone in self._learners}

    def picture(self, drone: int) -> npt.NDArray[np.uint8]:
        """Return a picture of a learner from behind, shape (240, 640, 3), RGB."""
        world = self.mission.world
        self._renderer = self._renderer or create_renderer(self._task.renderer, world)
        pose = world.pose(drone)
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, self._task.rig.left_mount_m)
        T_world_cam[:3, 3] += matmul(T_world_cam[:3, :3], BEHIND_M)
        (image,) = self._renderer.render([Camera(T_world_cam=T_world_cam, intrinsics=PICTURE)])
        return np.repeat(image.gray[..., None], 3, axis=2)

    def _create_agent(self, role: Role, config: MissionConfig) -> Agent:
        """Create a learner, or the agent of another drone."""
        if role.drone in self._learners:
            self.roles[role.drone], self._agents[role.drone] = role, Learner(role, config)
            return self._agents[role.drone]
        if self._task.others == "same":
            return load_controller(config.controller)(role, config)
        rules = config.rules.model_copy(update={"avoidance": False})
        return create_agent(role, config.model_copy(update={"rules": rules}))

    def _await_first_images(self) -> None:
        while any(self.situation(drone).percept is None for drone in self._learners):
            self.mission.tick()
            if self.mission.outcome is not None:
                remedy = "shorten mission.latency_s, or move the starts apart"
                ended = f"the mission ended with {self.mission.outcome.value!r} before the first image was known"
                raise MissionError(f"{ended}: {remedy}")

    def _result(self, drone: int, dt_s: float) -> StepResult:
        """Return what a step that took the simulated time `dt_s` was worth; the true positions decide."""
        mission, c = self.mission, self._task.reward
        outcome = mission.outcome
        leader_m, slot_m = self._distances_m(drone)
        approach_m, self._slot_m[drone] = self._slot_m[drone] - slot_m, slot_m
        reward = c.approach_per_m * approach_m - c.slot_per_s * min(slot_m / c.slot_scale_m, 1.0) * dt_s
        collided = outcome is Outcome.COLLISION and any(drone in hit.drones for hit in mission.world.contacts)
        lost = outcome is Outcome.LOST and min(leader_m, slot_m) > self._task.mission.lost_m
        arrived = outcome is Outcome.SUCCESS
        reward = reward + c.arrival * arrived - c.collision * collided - c.lost * lost
        terminated = collided or lost or arrived
        return StepResult(reward, terminated, outcome is not None and not terminated)

    def _distances_m(self, drone: int) -> tuple[float, float]:
        """Return the true distances of a learner from its leader and from its slot."""
        states, role = self.mission.world.states, self.roles[drone]
        from_leader_m = states[drone].position_m - states[role.team.leader].position_m
        return length(from_leader_m), length(from_leader_m - role.offset_m)


def checked_render_mode(render_mode: str | None) -> str | None:
    """Return a render mode; one that does not exist is a `MissionError`."""
    if render_mode is not None and render_mode not in RENDER_MODES:
        raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
    return render_mode


def clipped_action(action: npt.ArrayLike) -> FloatArray:
    """Return an action, clipped to -1..1; a shape other than (4,) or a value that is not finite is a `MissionError`."""
    given = np.asarray(action)
    if given.dtype.kind not in "fiu" or given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        expected = "four finite numbers (forward, left, up, turn to the left), in an array of shape (4,)"
        raise MissionError(f"an action must be {expected}, got {given.tolist()!r} of shape {given.shape}")
    return np.clip(given.astype(np.float64), -1, 1)
