"""Objects that are copied, pickled for another process, or described as JSON: they work, or say why not."""

import copy
import json
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from sim.depth_camera import DepthCamera
from sim.scenes import CitySpec, ForestSpec
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.environments.task import RewardConfig
from swarm.errors import MissionError
from swarm.gym import ID, TASKS
from swarm.recorder import Recorder
from tests.frames import require_equal, textured, walk
from tests.learning import quick
from voxdepth import create_corrector
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import CopyError
from voxdepth.geometry import compose
from voxdepth.pipeline import CorrectionPipeline
from voxdepth.registry import BUILTIN_NAMES
from voxdepth.types import CorrectedDepth, DepthCorrector, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=160, height_px=120, hfov_deg=86, baseline_m=0.095)
COPIES: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda given: pickle.loads(pickle.dumps(given)),  # noqa: S301
    "deepcopy": copy.deepcopy,
    "copy": copy.copy,  # Which would share the memory of a corrector, unless it knew better.
}
each_copy = pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)


@each_copy
@pytest.mark.parametrize("name", BUILTIN_NAMES)
def test_a_copy_of_a_new_corrector_gives_what_it_gives(name: str, copied: Callable[[Any], Any]) -> None:
    corrector = create_corrector(name, CAMERA)
    other = copied(corrector)
    for frame in walk(2, CAMERA):
        require_equal(other.process(frame), corrector.process(frame))


@each_copy
@pytest.mark.parametrize("spec", ["temporal[decimation=2]", "voxdepth[window_frames=3]", "learned"])
def test_a_corrector_with_a_memory_says_that_it_cannot_be_copied(spec: str, copied: Callable[[Any], Any]) -> None:
    corrector = CorrectorSpec.of(spec).create(CAMERA)
    corrector.process(walk(1, CAMERA)[0])
    with pytest.raises(CopyError, match=r"that remembers frames \(until reset\(\)\) cannot be copied.*CorrectorSpec"):
        copied(corrector)
    corrector.reset()
    copied(corrector).process(walk(1, CAMERA)[0])


def test_the_settings_of_a_corrector_come_along() -> None:
    spec = CorrectorSpec.of("temporal[decimation=2,fill=all]")
    for given in (spec.create(CAMERA), COPIES["pickle"](spec).create(CAMERA)):
        (frame,) = walk(1, CAMERA)
        other = COPIES["pickle"](given).process(frame)
        assert (other.depth_m > 0).all()
        require_equal(other, given.process(frame))


def test_a_pipeline_says_that_it_cannot_be_copied() -> None:
    pipeline = CorrectionPipeline(create_corrector("median", CAMERA), [])
    for copied in COPIES.values():
        with pytest.raises(CopyError, match="threads and a source"):
            copied(pipeline)


@each_copy
def test_a_compiled_function_is_itself_wherever_it_is_sent(copied: Callable[[Any], Any]) -> None:
    assert copied(compose) is compose


@each_copy
def test_a_camera_measures_what_its_copy_measures(copied: Callable[[Any], Any]) -> None:
    camera = DepthCamera("d435", seed=3)
    left, right = (textured(camera.intrinsics.shape, seed) for seed in (0, 1))
    first, second = (each.from_pair(left, right, frame=2) for each in (camera, copied(camera)))
    np.testing.assert_array_equal(first.depth_raw_m, second.depth_raw_m)
    np.testing.assert_array_equal(first.gray_left, second.gray_left)


def corrected(corrector: DepthCorrector) -> CorrectedDepth:
    return corrector.process(walk(1, CAMERA)[0])


@pytest.mark.slow
def test_another_process_corrects_by_a_corrector_that_is_sent_there() -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        require_equal(
            pool.submit(corrected, create_corrector("temporal", CAMERA)).result(100),
            corrected(create_corrector("temporal", CAMERA)),
        )


# Environments


@each_copy
def test_a_copy_of_an_environment_begins_the_same_episode(copied: Callable[[Any], Any]) -> None:
    env = LeaderFollowerEnv(render_mode="rgb_array", **quick())
    for given in (env, copied(env)):
        given.reset(seed=4)
        with pytest.raises(MissionError, match=r"with an episode cannot be copied.*call close\(\) before"):
            copied(given)
        given.close()
    other = copied(env)
    assert np.array_equal(other.reset(seed=5)[0]["depth_m"], env.reset(seed=5)[0]["depth_m"])
    assert np.array_equal(other.render(), env.render())
    env.close()
    other.close()


@pytest.mark.parametrize(
    "options",
    [
        {"scene": CitySpec(columns=2), "observation": "nearness"},
        {"scene": ForestSpec(), "corrector": "median", "reward": RewardConfig(lost=7.0)},
        {"scenario": "forest", "gray": True},
        {"mission": {"drones": 3}, "rig": {"depth": "fitted"}, "learner": 2},
        {"corrector": {"name": "temporal", "config": {"fill": "all"}}},
        quick(),
    ],
    ids=["scene", "reward", "scenario", "table", "corrector", "parts"],
)
def test_a_description_in_json_makes_the_same_environment(options: dict[str, Any]) -> None:
    env = gymnasium.make(f"swarm.gym:{ID}", **options)
    other = gymnasium.make(EnvSpec.from_json(env.spec.to_json()))
    assert other.unwrapped.task == env.unwrapped.task
    assert other.observation_space == env.observation_space


@pytest.mark.parametrize("name", TASKS)
def test_what_is_registered_is_described_in_json(name: str) -> None:
    spec = gymnasium.spec(name)
    again = EnvSpec.from_json(spec.to_json())
    assert gymnasium.make(again).unwrapped.task == gymnasium.make(spec).unwrapped.task
    json.dumps(spec.kwargs)


def test_a_recorder_cannot_be_described_and_stays_in_the_description() -> None:
    env = gymnasium.make(f"swarm.gym:{ID}", recorder=Recorder())
    assert isinstance(env.spec.kwargs["recorder"], Recorder)
    with pytest.raises((TypeError, ValueError), match="Recorder"):
        env.spec.to_json()


@pytest.mark.slow
def test_environments_fly_in_processes_of_their_own() -> None:
    options = {"vector_kwargs": {"context": "spawn"}, "vectorization_mode": "async"}
    envs = gymnasium.make_vec(f"swarm.gym:{ID}", num_envs=2, **options, **quick())
    observations, _ = envs.reset(seed=[3, 4])
    env = LeaderFollowerEnv(**quick())
    assert np.array_equal(observations["depth_m"][0], env.reset(seed=3)[0]["depth_m"])
    env.close()
    envs.close()
