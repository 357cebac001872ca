"""Broadcast of the drones' own states: what each one knows of the others beyond its camera."""

from collections import deque
from collections.abc import Sequence

from pydantic import Field

from sim.types import DroneState
from voxdepth.model import Model

from .types import Neighbour


class LinkConfig(Model):
    """Quality of the radio link."""

    delay_s: float = Field(0.05, ge=0)
    """Age of what is received; rounded to control ticks."""
    range_m: float = Field(40.0, gt=0)
    """Drones farther away are not heard; the leader's signal is relayed to all."""


class Link:
    """Delivers each drone's position and velocity to all others, late."""

    def __init__(self, config: LinkConfig, control_hz: float) -> None:
        self._range_m = config.range_m
        self._sent: deque[list[Neighbour]] = deque(maxlen=1 + round(config.delay_s * control_hz))

    def broadcast(self, states: Sequence[DroneState]) -> None:
        """Send everyone's state; call once per control tick."""
        self._sent.append(
            [Neighbour(drone=i, position_m=s.position_m, velocity_m_s=s.velocity_m_s) for i, s in enumerate(states)]
        )

    def heard_by(self, drone: int) -> list[Neighbour]:
        """The others within range, by their delayed positions."""
        heard = self._sent[0]
        own = heard[drone].position_m
        return [n for n in heard if n.drone != drone and float(((n.position_m - own) ** 2).sum()) <= self._range_m**2]

    def leader(self) -> Neighbour:
        """The leader (drone 0), delayed."""
        return self._sent[0][0]
