"""Episodes: what is seen, what is flown, and what it is worth."""

from contextlib import AbstractContextManager, closing
from typing import Any

import numpy as np
import pytest

from scenarios.config import Run, Scenario
from scenarios.flight import fly
from sim.engine import pybullet
from sim.sensor import RigConfig
from sim.types import Capture
from swarm.agents import create_agent
from swarm.config import MissionSetup
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.environments.learner import Learner, heading_frame, observe
from swarm.environments.task import LearningTask, RewardConfig
from swarm.errors import MissionError
from swarm.pilot import Situation
from swarm.recorder import Recorder
from swarm.types import Outcome
from tests.learning import DIVE, FORWARD, HOVER, TURN, quick, quick_task
from tests.swarm_scenes import Vector, flat, percept_of, role_of, situation_of, state
from voxdepth.types import CorrectedDepth


def situation(yaw_rad: float, *, leader_m: Vector = (0.0, 0.0, 0.0), depth_m: float = 7.0) -> Situation:
    """Of a drone at (1, 2, 3) m that flies along the world's x axis at 2 m/s."""
    return situation_of(state(1, 2, 3, (2, 0, 0), yaw_rad), leader_m, percept=percept_of(flat(depth_m)))


def test_vectors_are_in_the_heading_frame_and_clipped_to_their_limits() -> None:
    task, role = quick_task(), role_of(1, quick_task().mission)
    seen = observe(situation(np.pi / 2, leader_m=(5.0, 2.0, 4.0)), role, task)
    np.testing.assert_allclose(seen["leader_m"], [0, -4, 1], atol=1e-6)
    np.testing.assert_allclose(seen["velocity_m_s"], [0, -2, 0], atol=1e-6)
    x, y, _ = role.offset_m
    np.testing.assert_allclose(seen["slot_m"], [y, -4 - x, 1], atol=1e-6)
    far = observe(situation(0.0, leader_m=(90.0, 2.0, 3.0), depth_m=55.0), role, task)
    assert far["leader_m"][0] == 30
    assert (far["depth_m"] == 40).all()


@pytest.mark.parametrize(
    ("yaw_rad", "action", "expected_m_s"),
    [
        (0.0, [1, 0, 0, 0], [3.2, 0, 0]),
        (np.pi / 2, [0.5, 0, 0, 0], [0, 1.6, 0]),
        (np.pi / 2, [0, 1, 0, 0], [-3.2, 0, 0]),
        (0.3, [0, 0, -0.25, 1], [0, 0, -0.8]),
        (0.0, [1, 1, 0, -1], [3.2 / np.sqrt(2), 3.2 / np.sqrt(2), 0]),
    ],
)
def test_an_action_is_a_velocity_in_the_heading_frame_and_a_turn_at_the_yaw_rate(
    yaw_rad: float, action: list[float], expected_m_s: list[float]
) -> None:
    task = quick_task()
    learner = Learner(role_of(1, task.mission), task.mission)
    learner.action = np.array(action, np.float64)
    commands = [learner.decide(situation(yaw_rad)).command for _ in range(20)]
    np.testing.assert_allclose(commands[0].velocity_m_s, expected_m_s, atol=1e-9)
    assert commands[-1].yaw_rad == pytest.approx(action[3] * task.mission.pilot.yaw_rate_rad_s)  # 20 ticks are a second


class Captures(Recorder):
    """Keeps all captures with their corrected depth."""

    def __init__(self) -> None:
        self.kept: list[tuple[Capture, CorrectedDepth]] = []

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        self.kept.append((capture, corrected))


def opened(options: dict[str, Any]) -> AbstractContextManager[LeaderFollowerEnv]:
    """An environment that is closed in the end."""
    return closing(LeaderFollowerEnv(**options))


def off_m(env: LeaderFollowerEnv) -> float:
    """True distance of the learner from its slot."""
    states, role = env.mission.world.states, env.role
    return float(np.linalg.norm(states[role.drone].position_m - states[0].position_m - role.offset_m))


def straight_to_its_slot(observation: dict[str, Any]) -> list[float]:
    return [*np.clip(observation["slot_m"] / 2, -1, 1), 0.0]


@pytest.mark.parametrize("latency_s", [0.0, 0.03, 0.09])
def test_the_depth_is_the_corrected_one_and_known_only_after_its_latency(latency_s: float) -> None:
    options, images = quick(latency_s=latency_s), Captures()
    rig = options["rig"].model_copy(update={"depth": "stereo"})
    with opened(options | {"rig": rig, "corrector": "median", "recorder": images}) as env:
        observation, info = env.reset(seed=0)
        for _ in range(3):
            own = [(image.stamp_s, c.depth_m) for image, c in images.kept if image.drone == 1]
            known = [depth_m for stamp_s, depth_m in own if stamp_s + latency_s <= info["time_s"] + 1e-9]
            np.testing.assert_array_equal(observation["depth_m"], np.clip(known[-1], 0, rig.max_depth_m))
            observation, *_, info = env.step(FORWARD)
    assert any(not np.array_equal(c.depth_m, image.depth_true_m) for image, c in images.kept)


def test_a_follower_steered_by_the_rules_flies_as_in_the_mission() -> None:
    options = quick(control_hz=10)  # one decision per image, in both
    setup = {name: options[name] for name in MissionSetup.model_fields if name in options}
    mission = fly(Run(scenario=Scenario(name="same", **setup), seed=4), threads=1).result
    with opened(options) as env:
        _, info = env.reset(seed=4)
        task = env.task.mission
        rules, max_turn_rad = create_agent(env.role, task), task.pilot.yaw_rate_rad_s / task.control_hz
        path_m, yaw_rad, rewards = [], 0.0, []
        while "outcome" not in info:
            path_m.append(env.mission.world.states[1].position_m)
            known = env.situation()
            command = rules.decide(known).command
            velocity = heading_frame(known).T @ command.velocity_m_s / task.follower_speed_m_s
            action = [*velocity, (command.yaw_rad - yaw_rad) / max_turn_rad]
            _, reward, terminated, truncated, info = env.step(action)
            yaw_rad = command.yaw_rad
            rewards.append(reward)
    assert info["outcome"] == mission.outcome == Outcome.SUCCESS
    flown_m = mission.trajectories[1].position_m[1:]  # the first tick was flown before the first observation
    np.testing.assert_allclose(path_m, flown_m, atol=1e-6)
    assert np.linalg.norm(path_m[-1] - path_m[0]) > 3.5
    assert (terminated, truncated) == (True, False)
    assert rewards[-1] == pytest.approx(env.task.reward.arrival, abs=0.05)
    assert max(rewards[:-1]) <= 0


@pytest.mark.parametrize(
    ("options", "action", "outcome", "hit", "reward", "terminated"),
    [
        ({}, DIVE, "collision", [1], -50, True),
        ({"x_m": 40.0, "y_m": 2.6, "others": "blind", "duration_s": 30.0}, [0.78, 0, 0, 0], "collision", [0], 0, False),
        ({"lost_m": 5.0}, [-1, 0, 0, 0], "lost", [], -50, True),
        ({"duration_s": 1.0}, FORWARD, "timeout", [], 0, False),
    ],
    ids=["it dives", "its leader hits a tower", "it flies away", "time is over"],
)
def test_an_episode_ends_by_the_fault_of_the_learner_or_is_cut_short(
    options: dict[str, Any], action: list[float], outcome: str, hit: list[int], reward: float, terminated: bool
) -> None:
    with opened(quick(**options)) as env:
        _, info = env.reset(seed=0)
        before_s = 0.0
        while "outcome" not in info:
            before_s = info["time_s"]
            _, got, *ends, info = env.step(action)
        assert info["outcome"] == outcome
        assert [contact.drone for contact in env.mission.world.contacts] == hit
        assert got == pytest.approx(reward - min(off_m(env) / 8, 1) * (info["time_s"] - before_s))
        assert ends == [terminated, not terminated]
        with pytest.raises(MissionError, match=f"ended with '{outcome}'"):
            env.step(HOVER)


def test_another_drone_that_is_lost_is_no_fault_of_the_learner_far_from_its_leader_in_its_slot() -> None:
    with opened(quick(lost_m=2.0)) as env:
        env.reset(seed=0)
        world = env.mission.world
        far_m, q_xyzw = [0.0, 0.0, 99.0], [0.0, 0.0, 0.0, 1.0]
        pybullet.resetBasePositionAndOrientation(world.drone_ids[2], far_m, q_xyzw, physicsClientId=world.client)
        _, reward, terminated, truncated, info = env.step(HOVER)
    assert (info["outcome"], terminated, truncated) == ("lost", False, True)
    assert reward > -1


@pytest.mark.slow
def test_the_default_task_asks_for_eyes() -> None:
    """Who flies to its slot without a look at the depth hits a tower."""
    with opened({"corrector": "raw"}) as env:
        observation, info = env.reset(seed=0)
        while "outcome" not in info:
            observation, *_, info = env.step(straight_to_its_slot(observation))
        assert info["outcome"] == "collision"
        assert [contact.kind for contact in env.mission.world.contacts] == ["building"]


def test_crashing_early_never_pays_by_default() -> None:
    task, reward = LearningTask(), RewardConfig()
    assert min(reward.collision, reward.lost) >= reward.slot_per_s * task.mission.duration_s


def test_closing_frees_the_world_also_after_an_error() -> None:
    with opened(quick()) as env:
        env.reset(seed=0)
        client = env.mission.world.client
        assert pybullet.isConnected(client)
        env.close()
        assert not pybullet.isConnected(client)
    with pytest.raises(MissionError, match="before the first image was known: shorten"):
        LeaderFollowerEnv(**quick(latency_s=3.0, duration_s=1.0)).reset()
    assert not pybullet.isConnected(client)


@pytest.mark.parametrize("others", ["same", "blind"])
def test_the_learner_sees_the_same_whoever_the_others_are(others: str) -> None:
    images = Captures()
    with opened(quick() | {"others": others, "rig": RigConfig(width_px=80, height_px=60), "recorder": images}) as env:
        env.reset(seed=0)
        assert any((corrected.depth_m == 0).any() for _, corrected in images.kept), "a camera has holes"
    assert [capture.drone for capture, _ in images.kept] == ([0, 1, 2] if others == "same" else [1])


def test_the_shaping_adds_up_to_the_approach() -> None:
    with opened(quick() | {"reward": RewardConfig(slot_per_s=0.0, approach_per_m=2.0)}) as env:
        env.reset(seed=0)
        before_m = off_m(env)
        rewards = [env.step(action)[1] for action in (HOVER, HOVER, FORWARD, TURN, FORWARD)]
        assert sum(rewards) == pytest.approx(2 * (before_m - off_m(env)), abs=1e-9)


def test_nearness_falls_with_the_depth_and_is_0_where_nothing_is_known() -> None:
    task, role = quick_task().model_copy(update={"observation": "nearness"}), role_of(1, quick_task().mission)
    for depth_m, expected in ((0.5, 255), (1.0, 255), (2.0, 127), (10.0, 25), (0.0, 0)):
        seen = observe(situation(0.0, depth_m=depth_m), role, task)
        assert (seen["nearness"] == expected).all(), depth_m


@pytest.mark.slow
def test_the_default_observation_shows_the_world() -> None:
    """Of the pixels nearer than 20 m, resets included, 65 % are within 10 % of the truth."""
    images, good, near = Captures(), 0, 0
    for seed in range(3):
        with opened({"recorder": images}) as env:
            observation, info = env.reset(seed=seed)
            while "outcome" not in info and info["time_s"] < 12:
                observation, *_, info = env.step(straight_to_its_slot(observation))
    for capture, corrected in images.kept:
        is_near = capture.depth_true_m < 20
        error_m = np.abs(corrected.depth_m - capture.depth_true_m)
        near += np.count_nonzero(is_near)
        good += np.count_nonzero(is_near & (error_m < 0.1 * capture.depth_true_m))
    assert good / near > 0.65
