"""Broadcast of the drones' own states: what each one knows of the others beyond its camera."""

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

    delay_s: float = Field(0.05, ge=0)
    """Age of what is received; rounded to control ticks."""
    loss: float = Field(0.1, ge=0, lt=1)
    """Share of messages that a receiver misses, each by itself."""
    range_m: float = Field(40.0, gt=0)
    """Drones farther away are not heard; a leader's signal is relayed to all of its swarm."""
    memory_s: float = Field(1.0, ge=0)
    """How long a drone is taken to go on as it last said; then it counts as not heard."""


class Link:
    """Delivers each drone's position and velocity to all others: late, and not always.

    Args:
        config: See there.
        states: Of all drones at the start, which everybody knows.
        control_hz: Messages per second of each drone.
        seed: Master seed of the losses.
        leaders: Number of the leader of each drone.
    """

    def __init__(
        self, config: LinkConfig, states: Sequence[DroneState], control_hz: float, *, seed: int, leaders: Sequence[int]
    ) -> None:
        n = len(states)
        self._config = config
        self._leaders = np.asarray(leaders, np.intp)
        self._rng = stream(seed, Purpose.LINK)
        self._coming: deque[tuple[float, FloatArray, FloatArray]] = deque(maxlen=1 + round(config.delay_s * control_hz))
        # What every drone (first axis) last heard of every other one (second axis), and when that was said.
        self._position_m, self._velocity_m_s = (np.tile(array, (n, 1, 1)) for array in _motions(states))
        self._said_at_s = np.zeros((n, n))
        self._relayed = np.zeros((n, n), np.bool_)
        self._relayed[np.arange(n), self._leaders] = True

    def broadcast(self, states: Sequence[DroneState], time_s: float) -> None:
        """Send everyone's state and deliver what was sent before; call once per control tick."""
        self._coming.append((time_s, *_motions(states)))
        said_at_s, position_m, velocity_m_s = self._coming[0]
        apart_m = np.linalg.norm(position_m[:, None] - position_m[None], axis=2)
        heard = (apart_m <= self._config.range_m) | self._relayed
        heard &= self._rng.random(heard.shape) >= self._config.loss
        np.copyto(self._position_m, position_m, where=heard[..., None])
        np.copyto(self._velocity_m_s, velocity_m_s, where=heard[..., None])
        self._said_at_s[heard] = said_at_s

    def heard_by(self, drone: int, time_s: float) -> Neighbours:
        """The others that are still heard, where they are now if they went on as they said."""
        age_s = time_s - self._said_at_s[drone]
        known = age_s <= self._config.delay_s + self._config.memory_s + 1e-9
        known[drone] = False
        velocity_m_s = self._velocity_m_s[drone, known]
        position_m = self._position_m[drone, known] + age_s[known, None] * velocity_m_s
        return Neighbours(drone=np.flatnonzero(known), position_m=position_m, velocity_m_s=velocity_m_s)

    def leader_of(self, drone: int, time_s: float) -> Motion:
        """Its leader, by the last that was heard of it, however long ago."""
        leader = self._leaders[drone]
        velocity_m_s = self._velocity_m_s[drone, leader]
        age_s = min(time_s - self._said_at_s[drone, leader], self._config.delay_s + self._config.memory_s)
        return Motion(self._position_m[drone, leader] + age_s * velocity_m_s, velocity_m_s)


def _motions(states: Sequence[DroneState]) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities, each of shape (n, 3)."""
    return np.array([s.position_m for s in states]), np.array([s.velocity_m_s for s in states])
