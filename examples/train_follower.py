"""Train a follower with stable-baselines3, and compare it with a follower that only hovers.

The script needs stable-baselines3, which brings PyTorch:

    pip install -c constraints.txt -e '.[all]' stable-baselines3
    python examples/train_follower.py --steps 100000 --out follower.zip

A few hundred steps show that the script works; they teach the follower nothing.
"""

import argparse
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from stable_baselines3 import PPO
from stable_baselines3.common.monitor import Monitor

ENVIRONMENT = "swarm:voxdepth/LeaderFollower-v0"


class Nearness(gymnasium.ObservationWrapper):
    """Converts depth to an image that stable-baselines3 accepts: uint8, shape (1, H, W), 0 = unknown."""

    NEAR_M = 0.5
    """Depth that becomes 255; the value falls with 1 / depth, as disparity does."""

    def __init__(self, env: gymnasium.Env) -> None:
        super().__init__(env)
        height, width = env.observation_space["depth_m"].shape
        image = gymnasium.spaces.Box(0, 255, (1, height, width), np.uint8)
        self.observation_space = gymnasium.spaces.Dict({**env.observation_space.spaces, "depth_m": image})

    def observation(self, observation: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
        """Return the observation with the image in place of the depth."""
        depth_m = observation["depth_m"]
        nearness = np.where(depth_m > 0, self.NEAR_M / np.maximum(depth_m, self.NEAR_M), 0)
        return {**observation, "depth_m": np.uint8(255 * nearness)[None]}


def fly(model: PPO | None, env: gymnasium.Env, seeds: range) -> None:
    """Fly one episode per seed with the model, or hover without one, and print the outcome of each."""
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        total, done = 0.0, False
        while not done:
            action = np.zeros(4, np.float32) if model is None else model.predict(observation, deterministic=True)[0]
            observation, reward, terminated, truncated, info = env.step(action)
            total, done = total + float(reward), terminated or truncated
        print(f"  seed {seed}: return {total:7.2f}, {info['outcome']} after {info['time_s']:.1f} s")


def main() -> None:
    """Train, write the model, and fly a few episodes in worlds that the training did not use."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--steps", type=int, default=100_000, help="number of training steps of the environment")
    parser.add_argument("--seed", type=int, default=0, help="seed of the network and of the first world")
    parser.add_argument("--corrector", default="voxdepth", help="name of the depth corrector, as in `voxdepth run`")
    parser.add_argument("--episodes", type=int, default=3, help="number of episodes to compare")
    parser.add_argument("--out", default="follower.zip", help="file of the trained model")
    options = parser.parse_args()

    env = Monitor(Nearness(gymnasium.make(ENVIRONMENT, corrector=options.corrector)))
    model = PPO("MultiInputPolicy", env, n_steps=256, batch_size=64, seed=options.seed, verbose=1)
    model.learn(options.steps)
    model.save(options.out)

    seeds = range(1_000_000, 1_000_000 + options.episodes)
    print("hovering:")
    fly(None, env, seeds)
    print(f"after {model.num_timesteps} steps of training:")
    fly(model, env, seeds)
    env.close()


if __name__ == "__main__":
    main()
