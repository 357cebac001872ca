"""A leader and its followers, flying by what their cameras see."""

import sys

if "gymnasium" in sys.modules:  # for `gymnasium.make("swarm:voxdepth/LeaderFollower-v0")`; others pay nothing
    from . import gym as gym

del sys
