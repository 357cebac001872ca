"""Episodes: what is seen, what is flown, and what it is worth."""

from contextlib import closing

import numpy as np
import pytest

from scenarios.config import Run, Scenario
from scenarios.flight import fly
from sim.engine import pybullet
from sim.frames import quaternion_from_yaw
from sim.sensor import RigConfig
from sim.types import Capture, DroneState
from swarm.agents import create_agent
from swarm.config import MissionSetup
from swarm.controllers import Role
from swarm.environments.episode import Episode, StepResult
from swarm.environments.learner import Learner, heading_frame, observe
from swarm.environments.task import LearningTask, RewardConfig
from swarm.errors import MissionError
from swarm.pilot import Situation
from swarm.recorder import Recorder
from swarm.types import Motion, Outcome, Percept
from tests.learning import DIVE, FORWARD, HOVER, TURN, quick, quick_task
from tests.swarm_scenes import neighbours_of
from voxdepth.baselines.single_frame import Raw
from voxdepth.types import CorrectedDepth, Frame

DT_S = 0.1


def role_of(task: LearningTask, drone: int) -> Role:
    return Role(drone=drone, team=task.mission.teams()[0], radius_m=0.25, camera=task.rig.intrinsics)


def situation(yaw_rad: float, *, leader_m: tuple[float, float, float], depth_m: float = 7.0) -> Situation:
    """Of a drone at (1, 2, 3) m that flies along the world's x axis at 2 m/s."""
    frame = Frame(stamp_s=0, gray=np.zeros((4, 6), np.uint8), depth_m=np.full((4, 6), depth_m, np.float32))
    return Situation(
        time_s=0.0,
        own=DroneState(
            position_m=np.array([1.0, 2.0, 3.0]),
            velocity_m_s=np.array([2.0, 0.0, 0.0]),
            q_world_body_xyzw=quaternion_from_yaw(yaw_rad),
            rates_rad_s=np.zeros(3),
        ),
        percept=Percept(stamp_s=0, T_world_cam=np.eye(4), T_odom_cam=np.eye(4), corrected=Raw().process(frame)),
        leader=Motion(np.array(leader_m), np.zeros(3)),
        mates=neighbours_of({}),
        neighbours=neighbours_of({}),
    )


class TestObservation:
    def test_vectors_are_in_the_heading_frame(self) -> None:
        role = role_of(quick_task(), 1)
        seen = observe(situation(np.pi / 2, leader_m=(5.0, 2.0, 4.0)), role, quick_task())
        np.testing.assert_allclose(seen["leader_m"], [0, -4, 1], atol=1e-6)
        np.testing.assert_allclose(seen["velocity_m_s"], [0, -2, 0], atol=1e-6)
        x, y, _ = role.offset_m
        np.testing.assert_allclose(seen["slot_m"], [y, -4 - x, 1], atol=1e-6)

    def test_what_is_beyond_the_limits_is_clipped(self) -> None:
        seen = observe(situation(0.0, leader_m=(90.0, 2.0, 3.0), depth_m=55.0), role_of(quick_task(), 1), quick_task())
        assert seen["leader_m"][0] == 30
        assert (seen["depth_m"] == 40).all()

    def test_there_is_nothing_to_see_without_an_image(self) -> None:
        blind = Situation(**{**vars(situation(0.0, leader_m=(0.0, 0.0, 0.0))), "percept": None})
        with pytest.raises(MissionError, match="before the first image"):
            observe(blind, role_of(quick_task(), 1), quick_task())


class TestLearner:
    @pytest.mark.parametrize(
        ("yaw_rad", "action", "expected_m_s"),
        [
            (0.0, [1, 0, 0, 0], [3.2, 0, 0]),
            (np.pi / 2, [0.5, 0, 0, 0], [0, 1.6, 0]),
            (np.pi / 2, [0, 1, 0, 0], [-3.2, 0, 0]),
            (0.3, [0, 0, -0.25, 0], [0, 0, -0.8]),
            (0.0, [1, 1, 0, 0], [3.2 / np.sqrt(2), 3.2 / np.sqrt(2), 0]),
        ],
    )
    def test_an_action_is_a_velocity_in_the_heading_frame(
        self, yaw_rad: float, action: list[float], expected_m_s: list[float]
    ) -> None:
        task = quick_task()
        learner = Learner(role_of(task, 1), task.mission)
        learner.action = np.array(action, np.float64)
        decision = learner.decide(situation(yaw_rad, leader_m=(0.0, 0.0, 0.0)))
        np.testing.assert_allclose(decision.command.velocity_m_s, expected_m_s, atol=1e-9)

    def test_it_turns_at_most_at_the_yaw_rate(self) -> None:
        task = quick_task()
        learner = Learner(role_of(task, 1), task.mission)
        learner.action = np.array(TURN)
        here = situation(0.0, leader_m=(0.0, 0.0, 0.0))
        yaw_rad = [learner.decide(here).command.yaw_rad for _ in range(20)][-1]
        assert yaw_rad == pytest.approx(task.mission.pilot.yaw_rate_rad_s)  # 20 ticks are a second


class Images(Recorder):
    """Keeps what the corrector made of drone 1's images, by the time they were taken."""

    def __init__(self) -> None:
        self.depth_m: dict[float, np.ndarray] = {}
        self.differs_from_truth = False

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        if capture.drone == 1:
            self.depth_m[capture.stamp_s] = corrected.depth_m
            self.differs_from_truth |= not np.array_equal(corrected.depth_m, capture.depth_true_m)


@pytest.mark.parametrize("latency_s", [0.0, 0.03, 0.09])
def test_the_depth_is_the_corrected_one_and_known_only_after_its_latency(latency_s: float) -> None:
    options = quick(latency_s=latency_s)
    rig = options["rig"].model_copy(update={"depth": "stereo"})
    images = Images()
    episode = Episode(LearningTask(**options | {"rig": rig, "corrector": "median"}), 1, seed=0, recorder=images)
    for _ in range(3):
        now_s = episode.info()["time_s"]
        newest_s = max(stamp_s for stamp_s in images.depth_m if stamp_s + latency_s <= now_s + 1e-9)
        expected_m = np.clip(images.depth_m[newest_s], 0, rig.max_depth_m)
        np.testing.assert_array_equal(episode.observe()["depth_m"], expected_m)
        episode.step(FORWARD)
    assert images.differs_from_truth
    episode.close()


def test_a_follower_steered_by_the_rules_flies_as_in_the_mission() -> None:
    options = quick(control_hz=10)  # one decision per image, in both
    task = LearningTask(**options)
    setup = {name: options[name] for name in MissionSetup.model_fields if name in options}
    mission = fly(Run(scenario=Scenario(name="same", **setup), seed=4), threads=1).result
    episode = Episode(task, 1, seed=4)
    rules = create_agent(role_of(task, 1), task.mission)
    path_m, yaw_rad, rewards, verdict = [], 0.0, [], None
    max_turn_rad = task.mission.pilot.yaw_rate_rad_s / task.mission.control_hz
    while episode.outcome is None:
        path_m.append(episode.world.states[1].position_m)
        known = episode.situation()
        command = rules.decide(known).command
        velocity = heading_frame(known).T @ command.velocity_m_s / task.mission.follower_speed_m_s
        verdict = episode.step([*velocity, (command.yaw_rad - yaw_rad) / max_turn_rad])
        yaw_rad = command.yaw_rad
        rewards.append(verdict.reward)
    episode.close()
    assert episode.outcome is mission.outcome is Outcome.SUCCESS
    flown_m = mission.trajectories[1].position_m[1:]  # the first tick was flown before the first observation
    np.testing.assert_allclose(path_m, flown_m, atol=1e-6)
    assert np.linalg.norm(path_m[-1] - path_m[0]) > 3.5
    assert verdict.terminated
    assert rewards[-1] == pytest.approx(task.reward.arrival, abs=0.05)
    assert max(rewards[:-1]) <= 0


def ended(task: LearningTask, learner: int, action: list[float]) -> tuple[Episode, StepResult]:
    """An episode of always the same action, and its last step."""
    with closing(Episode(task, learner, seed=0)) as episode:
        while episode.outcome is None:
            last = episode.step(action)
        positions_m = [state.position_m for state in episode.world.states]
        off_m = np.linalg.norm(positions_m[learner] - positions_m[0] - role_of(task, learner).offset_m)
        return episode, last._replace(reward=last.reward + min(float(off_m) / 8, 1) * DT_S)


def test_a_dive_into_the_ground_costs_the_collision_and_the_way_from_the_slot() -> None:
    episode, last = ended(quick_task(), 1, DIVE)
    assert episode.outcome is Outcome.COLLISION
    assert episode.world.contacts[0].kind == "ground"
    assert last == StepResult(pytest.approx(-50), terminated=True, truncated=False)
    with pytest.raises(MissionError, match="ended with 'collision'"):
        episode.step(HOVER)


def test_the_collision_of_another_drone_cuts_short() -> None:
    """The leader flies into a tower."""
    episode, last = ended(quick_task(x_m=40.0, y_m=2.6, others="blind", duration_s=30.0), 2, [0.78, 0, 0, 0])
    assert [contact.drone for contact in episode.world.contacts] == [0]
    assert last == StepResult(pytest.approx(0), terminated=False, truncated=True)


def test_one_that_flies_away_is_lost() -> None:
    episode, last = ended(quick_task(lost_m=5.0), 1, [-1, 0, 0, 0])
    assert episode.outcome is Outcome.LOST
    assert last == StepResult(pytest.approx(-50), terminated=True, truncated=False)


def test_the_time_running_out_cuts_short_a_step_which_costs_the_time_that_was_flown() -> None:
    task = quick_task(duration_s=0.2)  # One tick of 0.05 s before the first observation, then steps of two ticks.
    episode = Episode(task, 1, seed=0)
    verdicts = [episode.step(FORWARD) for _ in range(2)]
    assert episode.outcome is Outcome.TIMEOUT
    assert [(v.terminated, v.truncated) for v in verdicts] == [(False, False), (False, True)]
    positions_m = [state.position_m for state in episode.world.states]
    off_m = float(np.linalg.norm(positions_m[1] - positions_m[0] - role_of(task, 1).offset_m))
    assert verdicts[1].reward == pytest.approx(-off_m / 8 * DT_S / 2)
    episode.close()


@pytest.mark.slow
def test_the_default_task_asks_for_eyes() -> None:
    """Who flies to its slot without a look at the depth hits a tower."""
    with closing(Episode(LearningTask(corrector="raw"), 1, seed=0)) as episode:
        while episode.outcome is None:
            episode.step([*np.clip(episode.observe()["slot_m"] / 2, -1, 1), 0.0])
        assert episode.outcome is Outcome.COLLISION
        assert [contact.kind for contact in episode.world.contacts] == ["building"]


def test_crashing_early_never_pays_by_default() -> None:
    task, reward = LearningTask(), RewardConfig()
    assert min(reward.collision, reward.lost) >= reward.slot_per_s * task.mission.duration_s


def test_closing_frees_the_world_also_after_an_error() -> None:
    before = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(before)
    episode = Episode(quick_task(), 1, seed=0)
    assert pybullet.isConnected(episode.world.client)
    client = episode.world.client
    episode.close()
    episode.close()
    assert not pybullet.isConnected(client)
    with pytest.raises(MissionError, match="before the first image was known: shorten"):
        Episode(quick_task(latency_s=3.0, duration_s=1.0), 1, seed=0)
    assert not pybullet.isConnected(client)


@pytest.mark.parametrize("others", ["same", "blind"])
def test_the_learner_sees_the_same_whoever_the_others_are(others: str) -> None:
    captured = []

    class Captures(Recorder):
        def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
            captured.append(capture.drone)

    changes = {"others": others, "rig": RigConfig(width_px=80, height_px=60)}
    task = quick_task().model_copy(update=changes)
    with closing(Episode(task, 1, seed=5, recorder=Captures())) as episode:
        own = episode.situation().percept
    assert (own.corrected.depth_m == 0).any(), "a camera has holes"
    assert captured == ([0, 1, 2] if others == "same" else [1])


def test_the_shaping_adds_up_to_the_approach() -> None:
    options = quick() | {"reward": RewardConfig(slot_per_s=0.0, approach_per_m=2.0)}
    with closing(Episode(LearningTask(**options), 1, seed=0)) as episode:

        def slot_m() -> float:
            at_m = [state.position_m for state in episode.world.states]
            return float(np.linalg.norm(at_m[1] - at_m[0] - role_of(quick_task(), 1).offset_m))

        before_m = slot_m()
        rewards = [episode.step(action).reward for action in (HOVER, HOVER, FORWARD, TURN, FORWARD)]
        assert sum(rewards) == pytest.approx(2 * (before_m - slot_m()), abs=1e-9)


def test_nearness_falls_with_the_depth_and_is_0_where_nothing_is_known() -> None:
    task, role = quick_task().model_copy(update={"observation": "nearness"}), role_of(quick_task(), 1)
    for depth_m, expected in ((0.5, 255), (1.0, 255), (2.0, 127), (10.0, 25), (0.0, 0)):
        seen = observe(situation(0.0, leader_m=(0.0, 0.0, 0.0), depth_m=depth_m), role, task)
        assert (seen["nearness"] == expected).all(), depth_m


@pytest.mark.slow
def test_the_default_observation_shows_the_world() -> None:
    """Of the pixels nearer than 20 m, resets included, 65 % are within 10 % of the truth."""
    good = near = 0

    class Count(Recorder):
        def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
            nonlocal good, near
            is_near = capture.depth_true_m < 20
            error_m = np.abs(corrected.depth_m - capture.depth_true_m)
            near += np.count_nonzero(is_near)
            good += np.count_nonzero(is_near & (error_m < 0.1 * capture.depth_true_m))

    for seed in range(6):
        with closing(Episode(LearningTask(), 1, seed=seed, recorder=Count())) as episode:
            while episode.outcome is None and episode.info()["time_s"] < 12:
                episode.step([*np.clip(episode.observe()["slot_m"] / 2, -1, 1), 0.0])
    assert good / near > 0.65
