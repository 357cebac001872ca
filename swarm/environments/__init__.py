"""Environments for learning: followers are steered from outside, all other drones fly by the mission's controller.

Only `gym_env` and `pettingzoo_env` need Gymnasium or PettingZoo.
"""
