"""Train a follower with stable-baselines3, and compare it with a blind one, the scripted one and one that hovers.

The script needs stable-baselines3, which brings PyTorch:

    pip install -c constraints.txt -e '.[all]' stable-baselines3
    python examples/train_follower.py --steps 20000 --seeds 0 1 2 --out follower

The blind follower is trained like the other one, but its depth image is always empty. With `--steering direct` nothing
but the policy keeps a follower from flying into a wall; otherwise the avoidance layer of the scripted drones does. The
folder receives a model of each training, `curve.png`, and `outcomes.csv`: how the episodes ended in worlds that no
training used. `--fly` flies followers that were trained before, perhaps with another depth. A few hundred steps show
that the script works; they teach the follower nothing.
"""

import argparse
import csv
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt
import pydantic

from swarm.compose import composed_mission
from swarm.environments.task import SMALL_RIG, LearningTask
from swarm.recorder import Recorder

try:
    import torch
    from stable_baselines3 import SAC
    from stable_baselines3.common.callbacks import BaseCallback
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.results_plotter import load_results
except ImportError as error:
    raise SystemExit(f"{error}: run `pip install -c constraints.txt stable-baselines3`") from error

ENVIRONMENT = "swarm:voxdepth/LeaderFollower-v0"
FIRST_TEST_SEED = 1_000_000
MEAN_OF = 10
"""Episodes that a point of the curve averages."""
REPORT_STEPS = 2000
"""Steps of a training between two lines of its progress."""
Policy = Callable[[Any], npt.NDArray[np.float32]]
"""Gives the action for an observation."""


class Scaled(gymnasium.ObservationWrapper):
    """Gives a small network vectors near 1, and a coarse image of nearness in place of the depth."""

    NEAR_M = 0.5
    """Depth of nearness 1; it falls with 1 / depth, as disparity does. Unknown depth has nearness 0."""
    BLOCK_PX = 4
    """The nearest of so many by so many pixels becomes a pixel."""
    UNITS: ClassVar = {"velocity_m_s": 2.0, "leader_m": 8.0, "slot_m": 8.0}
    """Values of the vectors that become 1."""

    def __init__(self, env: gymnasium.Env, blind: bool = False) -> None:
        super().__init__(env)
        height, width = env.observation_space["depth_m"].shape
        image = gymnasium.spaces.Box(0, 1, (height // self.BLOCK_PX, width // self.BLOCK_PX), np.float32)
        vectors = {name: gymnasium.spaces.Box(-np.inf, np.inf, (3,), np.float32) for name in self.UNITS}
        self.observation_space = gymnasium.spaces.Dict({"nearness": image, **vectors})
        self._blind = blind

    def observation(self, observation: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Return the observation as the network sees it; a blind follower's image is empty."""
        depth_m = observation["depth_m"]
        nearness = np.where(depth_m > 0, self.NEAR_M / np.maximum(depth_m, self.NEAR_M), 0).astype(np.float32)
        height, width = self.observation_space["nearness"].shape
        coarse = nearness.reshape(height, self.BLOCK_PX, width, self.BLOCK_PX).max(axis=(1, 3))
        vectors = {name: observation[name] / np.float32(unit) for name, unit in self.UNITS.items()}
        return {"nearness": coarse * np.float32(not self._blind), **vectors}


class Approach(gymnasium.Wrapper):
    """Adds a reward for each metre that a step brings the follower nearer to its slot, which tells it what to try.

    It is the shaping of Ng, Harada and Russell (1999) without the discount: the sum of an episode is the difference
    between the first and the last distance, so it cannot be earned by going to and fro.
    """

    PER_M = 4.0

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode and remember how far the slot is."""
        observation, info = self.env.reset(**options)
        self._slot_m = float(np.linalg.norm(observation["slot_m"]))
        return observation, info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Fly one step; the approach is a part of the reward."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        before_m, self._slot_m = self._slot_m, float(np.linalg.norm(observation["slot_m"]))
        return observation, float(reward) + self.PER_M * (before_m - self._slot_m), terminated, truncated, info


class Progress(BaseCallback):
    """Prints how far a training is."""

    def __init__(self, name: str, steps: int) -> None:
        super().__init__()
        self._name, self._steps = name, steps

    def _on_step(self) -> bool:
        if self.num_timesteps % REPORT_STEPS < self.training_env.num_envs:
            returns = [episode["r"] for episode in self.model.ep_info_buffer][-MEAN_OF:]
            mean = f"mean return {np.mean(returns):.0f}" if returns else "no episode has ended"
            print(f"{self._name}: {self.num_timesteps} of {self._steps} steps, {mean}", flush=True)
        return True


def task_of(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the environment."""
    rig = SMALL_RIG.model_copy(update={"depth": options.depth})
    return {"corrector": options.corrector, "rig": rig, "steering": options.steering, "others": "truth"}


def follower(task: dict[str, Any], blind: bool = False) -> gymnasium.Env:
    """Create the environment of a follower."""
    return Scaled(Approach(gymnasium.make(ENVIRONMENT, **task)), blind)


def train(options: argparse.Namespace, seed: int, blind: bool) -> Counter[str]:
    """Train one follower, whose episodes are logged below the output folder, and count the outcomes of its tests."""
    torch.set_num_threads(1)  # The other trainings need the other processors.
    name = _name(seed, blind)
    envs = make_vec_env(
        follower,
        n_envs=options.envs,
        seed=1000 * seed,
        env_kwargs={"task": task_of(options), "blind": blind},
        monitor_dir=str(options.out / name),
    )
    settings = {"gamma": 0.95, "learning_rate": 1e-3, "learning_starts": 500, "ent_coef": "auto_0.05"}
    model = SAC("MultiInputPolicy", envs, **settings, policy_kwargs={"net_arch": [64, 64]}, seed=seed)
    model.learn(options.steps, callback=Progress(name, options.steps))
    envs.close()
    model.save(options.out / f"{name}.zip")
    return tested(options, model, blind)


def tested(options: argparse.Namespace, model: SAC, blind: bool) -> Counter[str]:
    """Count how the episodes of a trained follower end."""
    return Counter(flown(options, lambda observation: model.predict(observation, deterministic=True)[0], blind))


def flown(options: argparse.Namespace, policy: Policy, blind: bool = False) -> Iterator[str]:
    """Fly an episode in each test world and give its outcome."""
    env = follower(task_of(options), blind)
    for seed in _test_seeds(options):
        observation, _ = env.reset(seed=seed)
        done = False
        while not done:
            observation, _, terminated, truncated, info = env.step(policy(observation))
            done = terminated or truncated
        yield info["outcome"]
    env.close()


def scripted(options: argparse.Namespace) -> Iterator[str]:
    """Fly the scripted follower in each test world and give the outcome of its mission."""
    task = LearningTask(**task_of(options))
    learner, *_ = task.followers
    others = set(range(task.mission.drones)) - {learner}
    for seed in _test_seeds(options):
        with composed_mission(
            task, Recorder(), latency_s=task.latency_s, seed=seed, gray=False, exact=others
        ) as mission:
            while mission.outcome is None:
                mission.tick()
            yield str(mission.outcome)


def draw(out: Path, seeds: Sequence[int]) -> None:
    """Draw the mean return of the last episodes over the steps of training, a line for each one."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for blind, color in ((False, "tab:blue"), (True, "tab:orange")):
        for seed in seeds:
            episodes = load_results(str(out / _name(seed, blind)))
            returns = episodes["r"].rolling(MEAN_OF, min_periods=1).mean()
            label = f"{'blind' if blind else 'with depth'}, a line for each seed" if seed == seeds[0] else None
            axes.plot(episodes["l"].cumsum(), returns, color=color, label=label)
    axes.set_xlabel("steps of training")
    axes.set_ylabel(f"mean return of the last {MEAN_OF} episodes")
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(out / "curve.png", dpi=120)


def write(outcomes: dict[str, Counter[str]], path: Path | None = None) -> None:
    """Print how often each follower's episodes ended in which way, and write it to a file."""
    kinds = sorted({kind for counted in outcomes.values() for kind in counted})
    lines = [["follower", "episodes", *kinds]]
    lines += [[name, str(c.total()), *(str(c[kind]) for kind in kinds)] for name, c in outcomes.items()]
    if path is not None:
        with path.open("w", newline="") as file:
            csv.writer(file).writerows(lines)
    for line in lines:
        print("  ".join(text.rjust(12) for text in line))


def _name(seed: int, blind: bool) -> str:
    return f"{'blind' if blind else 'sighted'}-{seed}"


def _test_seeds(options: argparse.Namespace) -> range:
    return range(FIRST_TEST_SEED, FIRST_TEST_SEED + options.episodes)


def trainings(options: argparse.Namespace) -> dict[str, Counter[str]]:
    """Train all followers, several at a time, and return the outcomes of each; Ctrl-C ends the trainings at once."""
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        running = {
            _name(seed, blind): pool.submit(train, options, seed, blind)
            for blind in (False, True)
            for seed in options.seeds
        }
        try:
            return {name: training.result() for name, training in running.items()}
        except BaseException:
            for worker in active_children():
                worker.terminate()
            raise


def parsed() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__.splitlines()[0], formatter_class=argparse.ArgumentDefaultsHelpFormatter
    )
    parser.add_argument("--steps", type=int, default=20_000, help="steps of the environment in each training")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of the trainings")
    parser.add_argument("--depth", choices=["truth", "noisy", "stereo"], default="stereo", help="what is corrected")
    parser.add_argument("--corrector", default="temporal", help="name of the depth corrector, as in `voxdepth run`")
    parser.add_argument("--steering", choices=["shielded", "direct"], default="shielded", help="what obeys the policy")
    parser.add_argument("--episodes", type=int, default=20, help="test worlds")
    parser.add_argument("--envs", type=int, default=2, help="environments of each training")
    parser.add_argument("--workers", type=int, default=2, help="trainings that run side by side")
    parser.add_argument("--out", type=Path, default=Path("follower"), help="folder of models, curve and outcomes")
    parser.add_argument("--fly", type=Path, nargs="+", metavar="ZIP", help="test these models of yours, train none")
    options = parser.parse_args()
    try:
        LearningTask(**task_of(options))
    except pydantic.ValidationError as error:
        parser.error(error.errors()[0]["msg"])
    return options


def main() -> None:
    """Train followers with and without depth, and compare them in worlds that the training did not use."""
    options = parsed()
    if options.fly:
        models = {path.stem: SAC.load(path) for path in options.fly}
        write({name: tested(options, model, name.startswith("blind")) for name, model in models.items()})
        return
    options.out.mkdir(parents=True, exist_ok=True)
    print(f"Followers that do not learn fly in {options.episodes} worlds.", flush=True)
    outcomes = {
        "hovering": Counter(flown(options, lambda observation: np.zeros(4, np.float32))),
        "scripted": Counter(scripted(options)),
    }
    outcomes |= trainings(options)
    draw(options.out, options.seeds)
    write(outcomes, options.out / "outcomes.csv")


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
