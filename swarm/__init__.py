"""A leader and its followers, which navigate with the depth of their cameras."""

import sys

if "gymnasium" in sys.modules:  # `gymnasium.make("swarm:voxdepth/LeaderFollower-v0")` imports this module to register
    from . import gym as gym

del sys
