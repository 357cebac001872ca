"""Environments for learning: followers that are steered from outside, between drones that fly by their rules.

With Gymnasium loaded, importing this package registers `voxdepth/LeaderFollower-v0`. Nothing here needs Gymnasium or
PettingZoo but `registration`, `spaces`, `gym_env` and `pettingzoo_env`.
"""

import sys

if "gymnasium" in sys.modules:
    from .registration import register

    register()
    del register

del sys
