"""Environments for learning: followers are steered from outside, the mission's controller flies all others.

Only `gym_env` and `pettingzoo_env` need Gymnasium or PettingZoo.
"""
