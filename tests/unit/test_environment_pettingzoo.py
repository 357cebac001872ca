"""The environment as PettingZoo knows it."""

import pickle
from copy import copy
from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.environments.pettingzoo_env import FollowersEnv, parallel_env
from swarm.errors import MissionError
from tests.learning import DIVE, FORWARD, HOVER, quick

AGENTS = ["drone_1", "drone_2"]


def array(action: list[float]) -> np.ndarray:
    return np.array(action, np.float32)


def test_pettingzoo_finds_nothing_to_warn_of() -> None:
    env = parallel_env(**quick(duration_s=1.5))
    parallel_api_test(env, num_cycles=20)
    assert env.agents == []
    env.close()


def test_the_same_seed_gives_the_same_episode() -> None:
    parallel_seed_test(lambda: parallel_env(**quick()), num_cycles=5)


def test_all_followers_are_agents() -> None:
    env = FollowersEnv(**quick())
    observations, infos = env.reset(seed=0)
    assert env.possible_agents == env.agents == list(observations) == list(infos) == AGENTS
    assert all(env.observation_space(agent).contains(observations[agent]) for agent in AGENTS)
    first, second = (observations[agent]["leader_m"] for agent in AGENTS)
    assert first[1] < 0 < second[1]


def test_each_flies_by_its_own_action() -> None:
    env = FollowersEnv(**quick())
    env.reset(seed=0)
    for _ in range(5):
        observations, *_ = env.step({"drone_1": array(HOVER), "drone_2": array([0, -1, 0, 0])})
    assert np.abs(observations["drone_1"]["velocity_m_s"]).max() < 0.05
    assert observations["drone_2"]["velocity_m_s"][1] < -1


def test_the_episode_ends_for_all_at_once() -> None:
    env = FollowersEnv(**quick())
    env.reset(seed=0)
    results: tuple[dict[str, Any], ...] = ()
    while env.agents:
        results = env.step({"drone_1": array(DIVE), "drone_2": array(HOVER)})
    _, rewards, terminated, truncated, infos = results
    assert terminated == {"drone_1": True, "drone_2": False}
    assert truncated == {"drone_1": False, "drone_2": True}
    assert rewards["drone_1"] < -50 < -0.2 < rewards["drone_2"]
    assert {info["outcome"] for info in infos.values()} == {"collision"}
    with pytest.raises(MissionError, match="ended with 'collision'"):
        env.step({"drone_1": array(HOVER), "drone_2": array(HOVER)})


def test_one_alone_sees_what_it_sees_among_others_at_the_start() -> None:
    alone, _ = LeaderFollowerEnv(learner=2, **quick()).reset(seed=0)
    together, _ = FollowersEnv(**quick()).reset(seed=0)
    for name, values in alone.items():
        np.testing.assert_array_equal(values, together["drone_2"][name])


def test_a_copy_flies_the_same_and_none_is_made_of_an_episode() -> None:
    env = FollowersEnv(render_mode="rgb_array", **quick())
    other = pickle.loads(pickle.dumps(env))  # noqa: S301
    first, second = env.reset(seed=1)[0], other.reset(seed=1)[0]
    np.testing.assert_array_equal(first["drone_2"]["depth_m"], second["drone_2"]["depth_m"])
    assert env.render().shape == (240, 640, 3)
    with pytest.raises(MissionError, match=r"with an episode cannot be copied"):
        copy(env)
    env.close()
    other.close()


@pytest.mark.parametrize("scenario", ["forest", "corridor"])
def test_the_followers_of_a_scenario_learn_together(scenario: str) -> None:
    env = parallel_env(scenario=scenario, depth="truth", corrector="raw", gray=True, mission={"drones": 3})
    observations, _ = env.reset(seed=0)
    assert list(observations) == AGENTS
    assert all(observations[agent] in env.observation_space(agent) for agent in AGENTS)
    env.close()


def test_every_agent_must_act_and_nobody_else() -> None:
    env = FollowersEnv(**quick())
    with pytest.raises(MissionError, match=r"call reset\(\) first"):
        env.step({})
    env.reset(seed=0)
    with pytest.raises(MissionError, match=r"each of \['drone_1', 'drone_2'\], got them for \['drone_1', 'drone_7'\]"):
        env.step({"drone_1": array(HOVER), "drone_7": array(FORWARD)})
