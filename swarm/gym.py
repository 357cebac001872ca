"""Importing this registers our environment with Gymnasium."""

import gymnasium

ID = "voxdepth/LeaderFollower-v0"
"""Found by `gymnasium.make("swarm:" + ID)` where Gymnasium was imported before us, by `"swarm.gym:" + ID` anywhere."""

gymnasium.register(id=ID, entry_point="swarm.environments.gym_env:LeaderFollowerEnv")
