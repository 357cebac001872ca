"""The radio link by which the drones broadcast their positions and velocities."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from pydantic import Field

from sim.seeds import Purpose, stream
from sim.types import DroneState
from voxdepth.model import Model
from voxdepth.types import FloatArray

from .types import Motion, Neighbours


class LinkConfig(Model):
    """Quality of the radio link."""

    delay_s: float = Field(default=0.05, ge=0)
    """Age of a message when it is received; rounded to control ticks."""
    loss: float = Field(default=0.1, ge=0, lt=1)
    """Probability that a receiver misses a message, independent of the other receivers and messages."""
    range_m: float = Field(default=40.0, gt=0)
    """Range of the radio; messages between a leader and its swarm are relayed."""
    memory_s: float = Field(default=1.0, ge=0)
    """Age of the last message, beyond `delay_s`, up to which a drone is extrapolated; then it counts as not heard."""


class Link:
    """Delivers positions and velocities of each drone to all others `control_hz` times a second, with delay and losses.

    A drone that drops out is no longer heard from that moment on.

    Args:
        config: Quality of the link.
        states: Motion of each drone at the start, which every drone knows.
        control_hz: Calls of `broadcast` per second.
        seed: Master seed of the run.
        leaders: Number of the leader of each drone.
    """

    def __init__(
        self, config: LinkConfig, states: Sequence[DroneState], control_hz: float, *, seed: int, leaders: Sequence[int]
    ) -> None:
        n = len(states)
        self._config = config
        self._leaders = np.asarray(leaders, np.intp)
        self._rng = stream(seed, Purpose.LINK)
        self._pending: deque[tuple[float, FloatArray, FloatArray]] = deque(
            maxlen=1 + round(config.delay_s * control_hz)
        )
        # The last message that every drone (first axis) received from every other one (second axis), and its time.
        self._position_m, self._velocity_m_s = (np.tile(array, (n, 1, 1)) for array in _motions(states))
        self._sent_at_s = np.zeros((n, n))
        self._sends = np.ones(n, np.bool_)
        self._relayed = np.zeros((n, n), np.bool_)
        self._relayed[np.arange(n), self._leaders] = self._relayed[self._leaders, np.arange(n)] = True

    def broadcast(self, states: Sequence[DroneState], time_s: float) -> None:
        """Send the states of all drones and deliver the messages that are due; call it once per control tick."""
        self._pending.append((time_s, *_motions(states)))
        sent_at_s, position_m, velocity_m_s = self._pending[0]
        apart_m = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
        heard = (apart_m <= self._config.range_m) | self._relayed
        heard &= self._rng.random(heard.shape) >= self._config.loss
        heard &= self._sends
        np.copyto(self._position_m, position_m, where=heard[..., None])
        np.copyto(self._velocity_m_s, velocity_m_s, where=heard[..., None])
        self._sent_at_s[heard] = sent_at_s

    def drop(self, drone: int) -> None:
        """Silence a drone for good."""
        self._sends[drone] = False
        self._sent_at_s[:, drone] = -np.inf

    def heard_by(self, drone: int, time_s: float) -> Neighbours:
        """Return the other drones that are still heard, extrapolated to `time_s` at constant velocity."""
        age_s = time_s - self._sent_at_s[drone]
        known = age_s <= self._config.delay_s + self._config.memory_s + 1e-9
        known[drone] = False
        velocity_m_s = self._velocity_m_s[drone, known]
        position_m = self._position_m[drone, known] + age_s[known, None] * velocity_m_s
        return Neighbours(drone=np.flatnonzero(known), position_m=position_m, velocity_m_s=velocity_m_s)

    def leader_of(self, drone: int, time_s: float) -> Motion:
        """Return the motion of a drone's leader, extrapolated from its last message for as long as it is remembered."""
        leader = self._leaders[drone]
        velocity_m_s = self._velocity_m_s[drone, leader]
        age_s = min(time_s - self._sent_at_s[drone, leader], self._config.delay_s + self._config.memory_s)
        return Motion(self._position_m[drone, leader] + age_s * velocity_m_s, velocity_m_s)


def _motions(states: Sequence[DroneState]) -> tuple[FloatArray, FloatArray]:
    return np.array([s.position_m for s in states]), np.array([s.velocity_m_s for s in states])
