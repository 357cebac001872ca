"""The name by which Gymnasium finds our environment."""

import gymnasium

ID = "voxdepth/LeaderFollower-v0"


def register() -> None:
    """Tell Gymnasium of it; a second call does nothing."""
    if ID not in gymnasium.registry:
        gymnasium.register(id=ID, entry_point="swarm.environments.gym_env:LeaderFollowerEnv")
