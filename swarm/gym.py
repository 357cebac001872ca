"""Importing this module registers the environment with Gymnasium."""

import gymnasium

ID = "voxdepth/LeaderFollower-v0"
"""`gymnasium.make("swarm.gym:" + ID)` always finds it, `"swarm:" + ID` if Gymnasium was imported before `swarm`."""

gymnasium.register(
    id=ID,
    entry_point="swarm.environments.gym_env:LeaderFollowerEnv",
    vector_entry_point="swarm.environments.vector_env:make",
)
