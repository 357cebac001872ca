"""Environments for learning: followers that are steered from outside, between drones that fly by their rules.

Nothing here needs Gymnasium or PettingZoo but `spaces`, `gym_env` and `pettingzoo_env`.
"""
