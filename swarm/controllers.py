"""The interface of controllers, and loading one by its name `module:factory`."""

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from sim.drone import AirframeConfig
from sim.types import VelocityCommand
from voxdepth.plugins import Plugin, load
from voxdepth.types import FloatArray, Intrinsics

from .config import DEFAULT_CONTROLLER, MissionConfig
from .pilot import Decision, Situation
from .team import Team


class Agent(Protocol):
    """Decides for one drone, once per control tick."""

    def decide(self, situation: Situation) -> Decision:
        """Return the command until the next tick."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Role:
    """What one drone is in its swarm."""

    drone: int
    """Number of the drone in the mission."""
    team: Team
    """Swarm of the drone."""
    airframe: AirframeConfig
    """Size and limits of every drone."""
    camera: Intrinsics
    """Camera of every drone."""

    @property
    def leads(self) -> bool:
        """Whether the drone is the leader; only the leader may use the goal of the team."""
        return self.drone == self.team.leader

    @property
    def offset_m(self) -> FloatArray:
        """Slot relative to the leader, shape (3,), world frame; 0 for the leader itself."""
        return np.asarray(self.team.offsets_m[self.drone - self.team.leader])


Factory = Callable[[Role, MissionConfig], Agent]
"""Creates the agent of one drone."""
SIGNATURE = "a factory(role, config) that returns an agent"
"""How the factory of a controller is called."""


def load_controller(name: str) -> Factory:
    """Return the factory that a name as `module:factory` stands for; agents of one that is not ours are checked.

    Raises:
        PluginError: See `plugins.load`.
    """
    if name == DEFAULT_CONTROLLER:
        ours: Factory = pkgutil.resolve_name(name)
        return ours
    factory = load("controller", name, SIGNATURE)
    return lambda role, config: PluginAgent(name, factory, role, config)


class PluginAgent:
    """The agent of a controller of a user. Every fault of it is a `PluginError`.

    Args:
        name: Name of the controller, `module:factory`.
        factory: What that name stands for.
        role: Drone that the agent decides for.
        config: Configuration of the mission, for the factory.
    """

    def __init__(self, name: str, factory: Factory, role: Role, config: MissionConfig) -> None:
        self._plugin = Plugin("controller", name, "decide", SIGNATURE, lambda: factory(role, config))
        self._drone = role.drone

    def decide(self, situation: Situation) -> Decision:
        """Return the command until the next tick."""
        when = f"for drone {self._drone} at {situation.time_s:.2f} s"
        decision: Decision = self._plugin.run(when, self._plugin.made.decide, situation)
        if fault := _fault_of(decision):
            raise self._plugin.faulty(f"{when}, expected {fault}")
        return decision


def _fault_of(decision: object) -> str | None:
    """Return what was expected of a decision, and what came; None if all is well."""
    if not isinstance(decision, Decision) or not isinstance(decision.command, VelocityCommand):
        got = type(getattr(decision, "command", decision)).__name__
        return f"a Decision with a VelocityCommand, got {got}"
    velocity_m_s, yaw_rad = decision.command.velocity_m_s, decision.command.yaw_rad
    for what, value, shape in (("velocity_m_s", velocity_m_s, (3,)), ("yaw_rad", yaw_rad, ())):
        numbers = np.array(value)
        is_array = isinstance(value, np.ndarray) or not shape
        if not is_array or numbers.shape != shape or numbers.dtype.kind not in "fiu" or not np.isfinite(numbers).all():
            return f"{what} as {'an array of ' if shape else ''}finite numbers of shape {shape}, got {value!r}"
    return None
