"""Who decides for a drone: ours, or one of yours by its name `module:factory`."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from voxdepth.types import FloatArray

from .errors import MissionError
from .pilot import Situation
from .team import Team
from .types import Decision

if TYPE_CHECKING:
    from .task import MissionConfig

DEFAULT_CONTROLLER = "swarm.agents:create_agent"


class Agent(Protocol):
    """Decides for one drone, once per control tick."""

    def decide(self, situation: Situation) -> Decision:
        """The command until the next tick."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Role:
    """What one drone is to do."""

    drone: int
    """Its number in the mission."""
    team: Team
    """Its swarm."""
    radius_m: float
    """Of the collision sphere of every drone."""

    @property
    def leads(self) -> bool:
        """Whether it is the leader: only that one may look at the goal of the team."""
        return self.drone == self.team.leader

    @property
    def offset_m(self) -> FloatArray:
        """Its slot relative to the leader, shape (3,), world frame; 0 for the leader itself."""
        offset_m: FloatArray = self.team.slots_m(np.zeros(3))[self.drone - self.team.leader]
        return offset_m


Factory = Callable[[Role, "MissionConfig"], Agent]
"""Makes the agent of one drone."""


def load_controller(name: str) -> Factory:
    """The factory that `module:factory` names. Importing the module runs its code.

    Raises:
        MissionError: There is no such module, or nothing in it of that name can be called.
    """
    module_name, colon, attribute = name.partition(":")
    if not (module_name and colon and attribute):
        raise MissionError(f"controller must be 'module:factory', as in {DEFAULT_CONTROLLER!r}, got {name!r}")
    try:
        factory = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError) as error:
        raise MissionError(
            f"controller {name!r} cannot be loaded: {error}; the module must be installed or in a folder that "
            "PYTHONPATH names, and have a function factory(role, config) that returns an agent"
        ) from error
    if not callable(factory):
        raise MissionError(f"controller {name!r} must be a function factory(role, config), got {factory!r}")
    made: Factory = factory
    return made
