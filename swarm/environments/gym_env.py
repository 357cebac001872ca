"""A Gymnasium environment: one follower learns, our controller flies all others."""

from contextlib import AbstractContextManager, ExitStack
from typing import Any

import cv2
import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from sim import frames
from sim.render import create_renderer
from sim.types import Camera
from voxdepth.arithmetic import length, matmul
from voxdepth.types import FloatArray, Intrinsics

from ..agents import create_agent
from ..compose import composed_mission
from ..config import MissionConfig
from ..controllers import Agent, Role, load_controller
from ..errors import MissionError
from ..mission import Mission
from ..pilot import Situation
from ..recorder import Recorder
from ..types import Outcome
from .learner import ACTION_SIZE, Learner, Observation, observe
from .task import LearningTask

Action = npt.NDArray[np.float32]
"""Speeds forward, left and up, and the turn to the left, within -1..1, shape (4,)."""
RENDER_MODES = ("rgb_array",)
PICTURE = Intrinsics.from_hfov(width_px=640, height_px=240, hfov_deg=100.0)
"""Camera that takes the pictures of the learner."""
BEHIND_M = np.array([0.0, -1.2, -4.0])
"""From the camera of the learner to that behind it, in its frame: x right, y down, z forward."""


class LeaderFollowerEnv(gymnasium.Env[Observation, Action]):
    """Learn to follow a leader through a world seen by a corrected depth camera.

    `gymnasium.make("swarm.gym:voxdepth/LeaderFollower-v0", **options)` makes one, which has OpenCV use one thread.
    An episode is a mission from take-off to its outcome, and a step one camera period. Drones that fly by their camera
    hover until its first image is known; blind ones fly from the start. The first observation is made at that time, and
    every later one as long after the capture of an image. Observations are described at `learner.Observation`, actions
    at `learner.Learner`, and rewards at `task.RewardConfig`. An episode is terminated when the learner collided or got
    lost, or the mission succeeded, and truncated when that ended in another way. `info` holds the `seed` of the
    episode, `time_s`, and when it has ended the `outcome`.

    Args:
        learner: Number of the learning drone; None takes the first follower.
        render_mode: `rgb_array`, or None for no pictures.
        recorder: Receives everything that happens, and is closed by who made it; None records nothing. Gray images are
            black if neither the corrector nor the sensor model needs them.
        task: As for `LearningTask.of`. What is unknown or impossible is a `MissionError`.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # noqa: RUF012

    def __init__(
        self,
        *,
        learner: int | None = None,
        render_mode: str | None = None,
        recorder: Recorder | None = None,
        **task: Any,
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise MissionError(f"render_mode must be one of {list(RENDER_MODES)} or None, got {render_mode!r}")
        cv2.setNumThreads(1)
        self.task = LearningTask.of(**task)
        self._drone = self.task.followers[0] if learner is None else learner
        if self._drone not in self.task.followers:
            raise MissionError(f"a learner must be a follower, one of {list(self.task.followers)}, got {learner}")
        self._recorder = recorder or Recorder()
        self._resources = ExitStack()
        self._mission: Mission | None = None
        self.render_mode = render_mode
        self.metadata = {**type(self).metadata, "render_fps": round(self.task.rig.rate_hz)}
        self.observation_space = observation_space(self.task)
        self.action_space = spaces.Box(-1.0, 1.0, (ACTION_SIZE,), np.float32)

    @property
    def mission(self) -> Mission:
        """The mission of the present episode; without an episode this is a `MissionError`."""
        if self._mission is None:
            raise MissionError("there is no episode: call reset() first, also after close()")
        return self._mission

    def situation(self) -> Situation:
        """Return what the learner knows, as a controller would get it; an expert to learn from may decide on it."""
        return self.mission.situation(self._drone)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode with a seed; None draws the next one from `np_random`. `options` have no effect.

        The seed is that of the scene and of all noise: the same seed and actions give the same observations, bit for
        bit. A task that cannot be flown is a `MissionError`.
        """
        super().reset(seed=seed)
        self._seed = int(self.np_random.integers(2**32)) if seed is None else seed
        self.close()
        try:
            self._mission = self._resources.enter_context(self._composed())
            self._await_first_image(self._mission)
        except BaseException:
            self.close()
            raise
        if self.render_mode is not None:
            self._renderer = create_renderer(self.task.renderer, self._mission.world)
        self._slot_m = self._distances_m()[1]
        return observe(self.situation(), self.role, self.task), self._info()

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Fly for one camera period, or to the end of the mission, by an action, of which values are clipped to -1..1.

        Without an episode, after its end, or for an unusable action, this is a `MissionError`.
        """
        mission = self.mission
        if mission.outcome is not None:
            ended = f"the episode has ended with {mission.outcome.value!r}"
            raise MissionError(f"{ended}; call reset() to begin another one")
        self._learner.action = clipped_action(action)
        control_hz, ticks = self.task.mission.control_hz, 0
        while ticks < round(control_hz / self.task.rig.rate_hz) and mission.outcome is None:
            mission.tick()
            ticks += 1
        reward, terminated = self._result(mission, ticks / control_hz)
        truncated = mission.outcome is not None and not terminated
        return observe(self.situation(), self.role, self.task), reward, terminated, truncated, self._info()

    def render(self) -> npt.NDArray[np.uint8] | None:
        """Return a picture of the learner from behind, shape (240, 640, 3), RGB; None without a render mode."""
        if self.render_mode is None:
            return None
        pose = self.mission.world.pose(self._drone)
        T_world_cam = frames.camera_pose(pose.position_m, pose.q_world_body_xyzw, self.task.rig.left_mount_m)
        T_world_cam[:3, 3] += matmul(T_world_cam[:3, :3], BEHIND_M)
        (image,) = self._renderer.render([Camera(T_world_cam=T_world_cam, intrinsics=PICTURE)])
        return np.repeat(image.gray[..., None], 3, axis=2)

    def close(self) -> None:
        """Free the world; a second call does nothing."""
        self._resources.close()
        self._mission = None

    def _composed(self) -> AbstractContextManager[Mission]:
        """Create the mission of an episode, which ends with the first collision."""
        config = self.task.mission.model_copy(update={"aftermath_s": 0.0, "after_contact": "end"})
        everyone = range(config.drones * len(config.routes))
        return composed_mission(
            self.task.model_copy(update={"mission": config}),
            self._recorder,
            latency_s=config.latency_s,
            seed=self._seed,
            gray=False,
            make_agent=self._create_agent,
            blind=[drone for drone in everyone if self.task.others == "blind" and drone != self._drone],
            measured=False,
        )

    def _create_agent(self, role: Role, config: MissionConfig) -> Agent:
        """Create the learner, or the agent of another drone."""
        if role.drone == self._drone:
            self.role, self._learner = role, Learner(role, config)
            return self._learner
        if self.task.others == "same":
            return load_controller(config.controller)(role, config)
        rules = config.rules.model_copy(update={"avoidance": False})
        return create_agent(role, config.model_copy(update={"rules": rules}))

    def _await_first_image(self, mission: Mission) -> None:
        while self.situation().percept is None:
            mission.tick()
            if mission.outcome is not None:
                remedy = "shorten mission.latency_s, or move the starts apart"
                ended = f"the mission ended with {mission.outcome.value!r} before the first image was known"
                raise MissionError(f"{ended}: {remedy}")

    def _result(self, mission: Mission, dt_s: float) -> tuple[float, bool]:
        """Return the reward of a step that took the simulated time `dt_s`, and whether the learner ended the episode.

        Both are decided by the true positions.
        """
        c, outcome = self.task.reward, mission.outcome
        leader_m, slot_m = self._distances_m()
        approach_m, self._slot_m = self._slot_m - slot_m, slot_m
        reward = c.approach_per_m * approach_m - c.slot_per_s * min(slot_m / c.slot_scale_m, 1.0) * dt_s
        collided = outcome is Outcome.COLLISION and any(self._drone in hit.drones for hit in mission.world.contacts)
        lost = outcome is Outcome.LOST and min(leader_m, slot_m) > self.task.mission.lost_m
        arrived = outcome is Outcome.SUCCESS
        return reward + c.arrival * arrived - c.collision * collided - c.lost * lost, collided or lost or arrived

    def _distances_m(self) -> tuple[float, float]:
        """True distances of the learner from its leader and from its slot."""
        states, role = self.mission.world.states, self.role
        from_leader_m = states[role.drone].position_m - states[role.team.leader].position_m
        return length(from_leader_m), length(from_leader_m - role.offset_m)

    def _info(self) -> dict[str, Any]:
        """Return the seed, the simulated time and the outcome if there is one, and nothing else of the truth."""
        outcome = self.mission.outcome
        ended = {} if outcome is None else {"outcome": outcome.value}
        return {"seed": self._seed, "time_s": self.mission.time_s, **ended}


def observation_space(task: LearningTask) -> spaces.Dict:
    """Return the space of `learner.Observation`."""
    max_speed_m_s, lost_m, shape = task.airframe.max_speed_m_s, task.mission.lost_m, task.rig.intrinsics.shape
    depth_m = spaces.Box(0.0, task.rig.max_depth_m, shape, np.float32)
    nearness = spaces.Box(0, 255, (1, *shape), np.uint8)
    return spaces.Dict(
        {
            **({"depth_m": depth_m} if task.observation == "metres" else {"nearness": nearness}),
            "velocity_m_s": spaces.Box(-max_speed_m_s, max_speed_m_s, (3,), np.float32),
            "leader_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
            "slot_m": spaces.Box(-lost_m, lost_m, (3,), np.float32),
        }
    )


def clipped_action(action: npt.ArrayLike) -> FloatArray:
    """Return an action, clipped to -1..1; a shape other than (4,) or a value that is not finite is a `MissionError`."""
    given = np.asarray(action)
    if given.dtype.kind not in "fiu" or given.shape != (ACTION_SIZE,) or not np.isfinite(given).all():
        expected = "four finite numbers (forward, left, up, turn to the left), in an array of shape (4,)"
        raise MissionError(f"an action must be {expected}, got {given.tolist()!r} of shape {given.shape}")
    return np.clip(given.astype(np.float64), -1, 1)
