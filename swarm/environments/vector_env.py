"""Several environments side by side: `gymnasium.make_vec(name, 4, vectorization_mode="vector_entry_point")`."""

from functools import partial
from typing import Any

import cv2
from gymnasium.vector import AsyncVectorEnv

from .gym_env import LeaderFollowerEnv


def make(num_envs: int, **options: Any) -> AsyncVectorEnv:
    """Make environments that step in a process each, on one thread each, with observations in shared memory.

    Half of a step is Python, which threads of one process cannot share; processes need no lock.

    Args:
        num_envs: Number of environments; as many as processors are fastest.
        options: Those of `LeaderFollowerEnv`.
    """
    return AsyncVectorEnv([partial(_make_one, **options)] * num_envs, context="spawn")


def _make_one(**options: Any) -> LeaderFollowerEnv:
    cv2.setNumThreads(1)
    return LeaderFollowerEnv(**options)
