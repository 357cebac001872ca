"""Train followers that avoid obstacles by their eyes alone, and test them in worlds that no training used.

A follower flies through the streets of a city, below a leader that flies over the roofs. It learns from the controller
of this project by DAgger [1]_: it flies, and learns at each step what the controller would have done there. The
controller sees the true depth and remembers what it saw; the follower has the last three images of a camera, by the
fast sensor model `fitted`. A blind follower is trained alike, but its images are always empty. Nothing but the network
keeps a follower from the walls. The script needs PyTorch:

    pip install -c constraints.txt -e '.[all]' torch
    python examples/train_follower.py train --seeds 0 1 2 --out follower
    python examples/train_follower.py test follower/*.pt --depth stereo --corrector temporal

`train` writes a network of each training and `curve.png`; `test` prints how the episodes ended.

References:
    .. [1] Ross, Gordon and Bagnell 2011, A reduction of imitation learning and structured prediction to no-regret
       online learning, AISTATS.
"""

import argparse
import csv
import json
import sys
from collections import Counter, deque
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import numpy.typing as npt

from sim.frames import yaw_from_quaternion
from sim.types import Capture
from swarm.agents import create_agent
from swarm.environments.gym_env import LeaderFollowerEnv
from swarm.environments.learner import Observation, heading_frame
from swarm.recorder import Recorder
from swarm.types import Outcome
from voxdepth.baselines.single_frame import Raw
from voxdepth.types import CorrectedDepth, Frame

try:
    import torch
    from torch import nn
except ImportError as error:
    raise SystemExit(f"{error}: run `pip install -c constraints.txt torch`") from error

Array = npt.NDArray[np.float32]

FIRST_TRAINING_SEED, FIRST_TEST_SEED = 0, 1_000_000
EPISODES, EPOCHS = 12, 30
"""Episodes of a round of a training, and the passes over all steps that were flown."""
BLOCK_PX, IMAGES = 5, 3
"""The nearest of so many by so many pixels is a pixel for the network, which gets so many images."""
UNITS = {"velocity_m_s": 3.0, "leader_m": 15.0, "slot_m": 5.0}
"""Values of the vectors that become 1."""
ASIDE = np.array([1, -1, 1], np.float32), np.array([1, -1, 1, -1], np.float32)
"""Signs of a vector and of an action in a mirror."""


class Eyes:
    """Turns observations into inputs of a network: coarse images and vectors near 1, and their mirror image."""

    def __init__(self, blind: bool) -> None:
        self._blind = blind
        self._images: deque[Array] = deque(maxlen=IMAGES)

    def __call__(self, observation: Observation) -> tuple[Array, Array]:
        """Return the input, and that of the mirrored world; episodes need eyes of their own."""
        _, height, width = observation["nearness"].shape
        blocks = observation["nearness"].reshape(height // BLOCK_PX, BLOCK_PX, width // BLOCK_PX, BLOCK_PX)
        coarse = blocks.max(axis=(1, 3)) / np.float32(64) * np.float32(not self._blind)
        self._images.extend([coarse] * (IMAGES - len(self._images)) or [coarse])
        images, vectors = np.stack(self._images), [observation[name] / np.float32(unit) for name, unit in UNITS.items()]
        seen = np.concatenate([images.ravel(), *vectors])
        return seen, np.concatenate([images[..., ::-1].ravel(), *(vector * ASIDE[0] for vector in vectors)])


def network(n_inputs: int) -> nn.Module:
    """Create a network from inputs to actions."""
    hidden = [nn.Linear(n_inputs, 256), nn.ReLU(), nn.Linear(256, 128), nn.ReLU()]
    return nn.Sequential(*hidden, nn.Linear(128, 4), nn.Tanh())


def act(model: nn.Module, seen: Array) -> Array:
    """Return the action of a network."""
    with torch.no_grad():
        return np.asarray(model(torch.from_numpy(seen)[None])[0].numpy())


class Teacher:
    """What the controller of this project would do in the place of a follower."""

    def __init__(self, env: LeaderFollowerEnv, truth: "Truth") -> None:
        mission = env.task.mission
        self._agent = create_agent(env.role, mission)
        self._speed_m_s = mission.follower_speed_m_s
        self._turn_rad = mission.pilot.yaw_rate_rad_s / mission.control_hz
        self._env, self._truth = env, truth

    def action(self) -> Array:
        """Return its action for the present step."""
        known = self._env.situation()
        assert known.percept is not None, "an episode begins with an image"
        known = replace(known, percept=replace(known.percept, corrected=self._truth.corrected))
        command = self._agent.decide(known).command
        velocity = heading_frame(known).T @ command.velocity_m_s / self._speed_m_s
        turn_rad = command.yaw_rad - yaw_from_quaternion(known.own.q_world_body_xyzw)
        turn = ((turn_rad + np.pi) % (2 * np.pi) - np.pi) / self._turn_rad
        return np.clip([*velocity, turn], -1, 1).astype(np.float32)


class Truth(Recorder):
    """Keeps the newest true depth of the follower's camera, as a camera without errors would deliver it."""

    def __init__(self) -> None:
        self._raw = Raw()

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Keep the truth of a capture."""
        frame = Frame(stamp_s=capture.stamp_s, gray=capture.gray_left, depth_m=np.minimum(capture.depth_true_m, 40))
        self.corrected = self._raw.process(frame)


def environment(depth: str, corrector: str, recorder: Recorder | None = None) -> LeaderFollowerEnv:
    """Return the environment of a follower."""
    return LeaderFollowerEnv(observation="nearness", depth=depth, corrector=corrector, recorder=recorder)


def taught(model: nn.Module | None, seed: int, blind: bool, rng: np.random.Generator) -> list[tuple[Array, Array]]:
    """Fly an episode, and return inputs of the network with the actions of the teacher.

    Args:
        model: The network that flies; None lets the teacher fly.
        seed: Seed of the episode.
        blind: Whether the network sees no image.
        rng: Source of the errors in the actions that are flown.
    """
    truth, eyes, steps = Truth(), Eyes(blind), []
    with closing(environment("fitted", "raw", truth)) as env:
        observation, info = env.reset(seed=seed)
        teacher = Teacher(env, truth)
        while "outcome" not in info:
            (seen, mirrored), wanted = eyes(observation), teacher.action()
            steps += [(seen, wanted), (mirrored, wanted * ASIDE[1])]
            flown = wanted if model is None else act(model, seen)
            noisy = flown + rng.normal(0, [0.1, 0.3, 0.1, 0.2])  # Errors to recover from.
            observation, *_, info = env.step(noisy)
    return steps


def train(options: argparse.Namespace, seed: int, blind: bool) -> str:
    """Train one follower; the folder receives its network and its curve."""
    torch.set_num_threads(1)  # The other trainings need the other processors.
    torch.manual_seed(seed)
    name, rng, model = f"{'blind' if blind else 'sighted'}-{seed}", np.random.default_rng(seed), None
    steps: list[tuple[Array, Array]] = []
    curve: list[tuple[int, float]] = []
    for round_ in range(options.rounds):
        first = FIRST_TRAINING_SEED + 1000 * seed + EPISODES * round_
        for world in range(first, first + EPISODES):
            steps += taught(model, world, blind, rng)
        model = fitted(model, steps)
        outcomes = flown(model, environment("fitted", "raw"), range(900_000, 900_010), blind)
        curve.append((len(steps) // 2, outcomes["success"] / outcomes.total()))
        print(f"{name}: {curve[-1][0]} steps, {100 * curve[-1][1]:.0f} % arrive", flush=True)
        torch.save(model.state_dict(), options.out / f"{name}.pt")
        (options.out / f"{name}.json").write_text(json.dumps(curve), encoding="utf-8")
    return name


def fitted(model: nn.Module | None, steps: Sequence[tuple[Array, Array]]) -> nn.Module:
    """Return a network that does in all steps what the teacher wanted, from that of the last round on."""
    seen, wanted = (torch.from_numpy(np.stack(values)) for values in zip(*steps, strict=True))
    model = model or network(seen.shape[1])
    optimiser = torch.optim.Adam(model.parameters(), lr=1e-3, weight_decay=1e-5)
    for _ in range(EPOCHS):
        for batch in torch.randperm(len(seen)).split(512):
            optimiser.zero_grad()
            nn.functional.smooth_l1_loss(model(seen[batch]), wanted[batch]).backward()
            optimiser.step()
    return model


def flown(model: nn.Module, env: LeaderFollowerEnv, seeds: Sequence[int], blind: bool) -> Counter[str]:
    """Count how episodes of a follower end.

    Args:
        model: The network that flies.
        env: Its environment, which is closed at the end.
        seeds: Seeds of the episodes.
        blind: Whether the network sees no image.
    """
    outcomes = Counter[str]()
    with closing(env):
        for seed in seeds:
            eyes, (observation, info) = Eyes(blind), env.reset(seed=seed)
            while "outcome" not in info:
                observation, *_, info = env.step(act(model, eyes(observation)[0]))
            outcomes[info["outcome"]] += 1
    return outcomes


def test(options: argparse.Namespace, path: Path) -> Counter[str]:
    """Count how the episodes of a trained follower end in the test worlds."""
    torch.set_num_threads(1)
    state = torch.load(path, weights_only=True)
    model = network(state["0.weight"].shape[1])
    model.load_state_dict(state)
    seeds = range(FIRST_TEST_SEED, FIRST_TEST_SEED + options.worlds)
    return flown(model, environment(options.depth, options.corrector), seeds, path.stem.startswith("blind"))


def draw(out: Path) -> None:
    """Draw the share of arrivals after each round of training, a line for each follower."""
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    for path in sorted(out.glob("*.json")):
        steps, arrived = zip(*json.loads(path.read_text(encoding="utf-8")), strict=True)
        is_blind, is_first = path.stem.startswith("blind"), path.stem.endswith("-0")
        label = ("blind" if is_blind else "with depth") if is_first else None
        axes.plot(steps, arrived, "o-", color="tab:orange" if is_blind else "tab:blue", label=label)
    axes.set(xlabel="steps that were flown in training", ylabel="share of 10 other worlds in which it arrives")
    axes.set_ylim(0, 1.05)
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(out / "curve.png", dpi=110)


def parsed() -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--workers", type=int, default=2, help="followers at a time; 2 by default")
    commands = parser.add_subparsers(dest="command", required=True)
    training = commands.add_parser("train", help="train followers, with depth and blind")
    training.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="seeds of the trainings; 0 1 2")
    training.add_argument("--rounds", type=int, default=5, help="rounds of a training; 5 by default")
    training.add_argument("--out", type=Path, default=Path("follower"), help="folder of networks and curve")
    testing = commands.add_parser("test", help="test followers in worlds that no training used")
    testing.add_argument("networks", type=Path, nargs="+", metavar="PT", help="networks of trainings")
    testing.add_argument("--worlds", type=int, default=50, help="test worlds; 50 by default")
    testing.add_argument("--depth", choices=["truth", "fitted", "stereo"], default="stereo", help="sensor model")
    testing.add_argument("--corrector", default="temporal", help="depth corrector, as in `voxdepth run`")
    return parser.parse_args()


def main() -> None:
    """Train, or test what was trained."""
    options = parsed()
    with ProcessPoolExecutor(options.workers, mp_context=get_context("spawn")) as pool:
        if options.command == "train":
            options.out.mkdir(parents=True, exist_ok=True)
            jobs = [(seed, blind) for seed in options.seeds for blind in (False, True)]
            list(pool.map(train, [options] * len(jobs), *zip(*jobs, strict=True)))
            draw(options.out)
            return
        outcomes = list(pool.map(test, [options] * len(options.networks), options.networks))
    table = csv.writer(sys.stdout)
    kinds = [outcome.value for outcome in Outcome]
    table.writerow(["follower", *kinds])
    table.writerows(
        [path.stem, *(c[kind] for kind in kinds)] for path, c in zip(options.networks, outcomes, strict=True)
    )


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
