"""Environments for learning: a follower is steered from outside, our controller flies all other drones.

Only `gym_env` needs Gymnasium.
"""
