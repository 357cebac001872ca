"""The environment as Gymnasium knows it."""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from scenarios.config import load_run
from sim.scenes import GapSpec
from sim.sensor import RigConfig
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.environments.task import LearningTask, pair
from swarm.errors import MissionError
from swarm.gym import TASKS
from tests.learning import FORWARD, QUICK_RIG, TURN, quick

NAME = "swarm.gym:voxdepth/LeaderFollower-v0"


def array(action: list[float]) -> np.ndarray:
    return np.array(action, np.float32)


@pytest.mark.parametrize("observation", ["metres", "nearness"])
def test_gymnasium_finds_nothing_to_warn_of(observation: str) -> None:
    env = gymnasium.make(NAME, render_mode="rgb_array", observation=observation, **quick())
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize("name", sorted(TASKS))
def test_every_task_begins_with_an_image_of_its_world(name: str) -> None:
    env = gymnasium.make(f"swarm.gym:{name}", depth="fitted", corrector="raw")
    first, second = (env.reset(seed=seed)[0] for seed in (0, 1))
    env.close()
    assert first in env.observation_space
    assert not np.array_equal(first["depth_m"], second["depth_m"]), "every seed builds another world"


def test_the_parts_of_a_scenario_make_a_task() -> None:
    scenario = load_run("pillars", None, {}).scenario
    parts = {name: getattr(scenario, name) for name in ("scene", "mission", "rig")}
    env = LeaderFollowerEnv(depth="truth", corrector="raw", others="same", **parts)
    observation, _ = env.reset(seed=3)
    assert observation["depth_m"].shape == scenario.rig.intrinsics.shape
    env.close()


def shown(name: str, **options: Any) -> tuple[dict[str, Any], LeaderFollowerEnv]:
    env = gymnasium.make(NAME, scenario=name, corrector="raw", **options).unwrapped
    observation, _ = env.reset(seed=1)
    env.close()
    return observation, env


@pytest.mark.parametrize("name", ["forest", "gap", "pillars"])
def test_the_scene_of_a_scenario_is_had_by_its_name(name: str) -> None:
    scenario = load_run(name, None, {}).scenario
    observation, env = shown(name, depth="truth")
    task, mission = env.task, scenario.mission
    assert (task.scene, task.airframe, task.others) == (scenario.scene, scenario.airframe, "same")
    assert task.mission == mission.model_copy(update={"latency_s": scenario.latency_s})
    assert task.rig == scenario.rig.model_copy(update={"depth": "truth"})
    assert observation in env.observation_space


def test_options_change_the_parts_of_a_scenario() -> None:
    task = LearningTask.of(scenario="forest", mission={"drones": 3}, others="blind", scene={"bushes": 5})
    forest = load_run("forest", None, {}).scenario
    assert (task.mission.drones, task.others) == (3, "blind")
    assert task.scene == forest.scene.model_copy(update={"bushes": 5})


def test_a_file_is_a_scenario_as_well(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text('name = "mine"\n[scene]\nkind = "gap"\n[mission]\ndrones = 2\n')
    assert LearningTask.of(scenario=str(tmp_path / "mine.toml")).scene == GapSpec()
    with pytest.raises(MissionError, match="did you mean forest"):
        LearningTask.of(scenario="forrest")


def test_without_the_testbed_a_scenario_says_what_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarm.environments.task.entry_points", lambda group: ())
    with pytest.raises(MissionError, match="'forest' is of the testbed, which is not installed"):
        LearningTask.of(scenario="forest")


@pytest.mark.parametrize(
    "options",
    [
        {"corrector": "median"},
        {"observation": "nearness"},
        {"rig": {"depth": "noisy", "width_px": 96, "height_px": 72}},
    ],
)
def test_gray_images_are_observed_beside_the_depth(options: dict[str, Any]) -> None:
    given = {name: value for name, value in quick().items() if name not in options}
    seen = []
    for gray in (True, False):
        env = gymnasium.make(NAME, gray=gray, **given, **options)
        env.reset(seed=2)
        seen.append(env.step(array(FORWARD))[0])
        assert seen[-1] in env.observation_space
        env.close()
    image = seen[0].pop("gray")
    assert (image.dtype, image.shape[1:]) == (np.uint8, env.unwrapped.task.rig.intrinsics.shape)
    assert image.std() > 5
    assert all(np.array_equal(seen[0][name], seen[1][name]) for name in seen[1])
    assert seen[0].keys() == seen[1].keys()


def steps(env: LeaderFollowerEnv, seed: int | None, n: int = 4) -> list[Any]:
    """All that comes out of an episode's first steps."""
    actions = [FORWARD, TURN, [0.3, -0.2, 0.1, 0.5], FORWARD]
    return [env.reset(seed=seed), *(env.step(array(actions[k % 4])) for k in range(n))]


def same(first: Any, second: Any) -> bool:
    """Whether all observations are the same, bit for bit, and so is all that comes with them."""
    return all(
        all(np.array_equal(a[0][name], b[0][name]) for name in a[0]) and a[1:] == b[1:]
        for a, b in zip(first, second, strict=True)
    )


@pytest.mark.parametrize(("depth", "corrector"), [("noisy", "median"), ("stereo", "temporal")])
def test_the_same_seed_and_actions_give_the_same_episode(depth: Any, corrector: str) -> None:
    options = quick() | {"rig": RigConfig(width_px=48, height_px=36, depth=depth), "corrector": corrector}
    env, other = LeaderFollowerEnv(**options), LeaderFollowerEnv(**options)
    first = steps(env, 7)
    assert same(first, steps(env, 7))
    assert same(first, steps(other, 7))
    assert not np.array_equal(first[1][0]["depth_m"], steps(env, 8)[1][0]["depth_m"])


def test_episodes_without_a_seed_differ_and_can_be_repeated() -> None:
    env = LeaderFollowerEnv(**quick())
    seeds = [env.reset(seed=5)[1]["seed"], *(env.reset()[1]["seed"] for _ in range(2))]
    assert seeds[0] == 5
    assert len(set(seeds)) == 3
    assert [env.reset(seed=5)[1]["seed"], *(env.reset()[1]["seed"] for _ in range(2))] == seeds
    last = steps(env, None)
    assert same(last, steps(env, last[0][1]["seed"]))


def test_a_step_lasts_one_camera_period() -> None:
    env = LeaderFollowerEnv(**quick() | {"rig": QUICK_RIG.model_copy(update={"rate_hz": 5.0})})
    times_s = [out[-1]["time_s"] for out in steps(env, 0)]
    np.testing.assert_allclose(np.diff(times_s), 0.2)
    assert env.metadata["render_fps"] == 5


def test_beyond_the_range_an_action_is_clipped() -> None:
    env = LeaderFollowerEnv(**quick())
    within, beyond = ([env.reset(seed=0), *(env.step(array(a)) for _ in range(5))] for a in (FORWARD, [9, 0, 0, 0]))
    assert same(within, beyond)
    assert np.linalg.norm(within[-1][0]["velocity_m_s"]) > 1


def test_a_picture_shows_the_learner_from_behind() -> None:
    env = LeaderFollowerEnv(render_mode="rgb_array", **quick())
    env.reset(seed=0)
    before, _ = env.render(), env.step(array(TURN))
    assert before.shape == (240, 640, 3)
    assert before.dtype == np.uint8
    assert before.std() > 10
    assert not np.array_equal(before, env.render())


@pytest.mark.parametrize(
    ("options", "text"),
    [
        *((quick() | {"learner": n}, rf"must be a follower, one of \[1, 2\], got {n}") for n in (0, 3, -1)),
        (quick(drones=1), "drones must be 2 or more, got 1"),
        ({"depth": "laser"}, "rig.depth: expected"),
        ({"scenario": "nowhere"}, "there is no scenario 'nowhere'"),
        ({"airframe": {"max_accel_m_s2": 9.81}}, "airframe.max_accel_m_s2: expected"),
        ({"corector": "raw"}, "corector"),
        ({"mission": {"rules": {"min_altitude_m": 18.0}}}, "at most max_altitude_m, got 18 and 17"),
        ({"render_mode": "human"}, r"one of \['rgb_array'\] or None, got 'human'"),
    ],
)
def test_options_that_cannot_be_are_reported(options: dict[str, Any], text: str) -> None:
    with pytest.raises(MissionError, match=text):
        LeaderFollowerEnv(**options)


def test_a_leader_may_fly_low() -> None:
    rules = pair((0.0, 0.0, 2.0), (9.0, 0.0, 2.0)).rules
    assert (rules.min_altitude_m, rules.max_altitude_m) == (2.0, 2.0)


def test_a_table_changes_the_keys_that_it_names() -> None:
    task = LearningTask.of(mission={"drones": 3}, rig={"depth": "fitted"}, scene={"columns": 1})
    assert (task.mission.drones, task.rig.depth, task.scene.columns) == (3, "fitted", 1)
    assert task.mission.routes == LearningTask().mission.routes
    assert LearningTask.of(scene={"kind": "gap"}).scene == GapSpec()


def test_the_followers_of_every_swarm_may_learn() -> None:
    routes = [{"start_m": (0.0, y_m, 17.0), "goal_m": (36.0, y_m, 17.0)} for y_m in (0.0, 9.0)]
    assert LearningTask.of(mission={"drones": 3, "routes": routes}).followers == (1, 2, 4, 5)


def test_an_action_has_four_finite_numbers_and_needs_an_episode() -> None:
    env = LeaderFollowerEnv(render_mode="rgb_array", **quick())
    for call in (lambda: env.step(array(FORWARD)), env.render):
        with pytest.raises(MissionError, match=r"call reset\(\) first"):
            call()
    env.reset(seed=0)
    for action in ([0.0] * 3, [[0.0] * 4], [0, 0, 0, np.nan], "left"):
        with pytest.raises(MissionError, match="four finite numbers"):
            env.step(np.array(action))
    env.close()
