"""The interface of controllers, and loading one by its name `module:factory`."""

import logging
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from multiprocessing import parent_process
from typing import Protocol

import numpy as np

from voxdepth.types import FloatArray

from .errors import MissionError
from .pilot import Decision, Situation
from .task import DEFAULT_CONTROLLER, MissionConfig
from .team import Team
from .types import OnboardCamera


class Agent(Protocol):
    """Decides for one drone, once per control tick."""

    def decide(self, situation: Situation) -> Decision:
        """Return the command until the next tick."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Role:
    """The place of one drone in its swarm."""

    drone: int
    """Number of the drone in the mission."""
    team: Team
    """Swarm of the drone."""
    radius_m: float
    """Radius of the collision sphere of every drone."""
    camera: OnboardCamera

    @property
    def leads(self) -> bool:
        """Whether the drone is the leader; only the leader may use the goal of the team."""
        return self.drone == self.team.leader

    @property
    def offset_m(self) -> FloatArray:
        """Slot relative to the leader, shape (3,), world frame; 0 for the leader itself."""
        offset_m: FloatArray = self.team.slots_m(np.zeros(3))[self.drone - self.team.leader]
        return offset_m


_LOGGER = logging.getLogger(__name__)

Factory = Callable[[Role, MissionConfig], Agent]
"""Creates the agent of one drone."""


def load_controller(name: str) -> Factory:
    """Import the module of `module:factory` and return its factory.

    The import runs the code of the module. A scenario or a study from somebody else may name any that is installed, so
    one that is not ours is logged before that.

    Raises:
        MissionError: There is no such module, or it has no callable of that name.
    """
    if not all(name.partition(":")):
        raise MissionError(f"controller must be 'module:factory', as in {DEFAULT_CONTROLLER!r}, got {name!r}")
    _announce(name)
    try:
        factory: Factory = pkgutil.resolve_name(name)
    except (ImportError, AttributeError, ValueError) as error:
        raise MissionError(
            f"controller {name!r} cannot be loaded: {error}; the module must be installed or in a folder that "
            "PYTHONPATH names, and have a function factory(role, config) that returns an agent"
        ) from error
    if not callable(factory):
        raise MissionError(f"controller {name!r} must be a function factory(role, config), got {factory!r}")
    return factory


@cache
def _announce(name: str) -> None:
    """Log the name of a controller that is not ours, once: not in a worker, whose parent loads it first."""
    if not name.startswith("swarm.") and parent_process() is None:
        _LOGGER.warning("this mission runs the code of %s: stop it if you do not know that", name)
