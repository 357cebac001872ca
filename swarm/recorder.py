"""What a mission reports while it runs. Two classes that answer the same calls, so that no loop asks which it has."""

from collections.abc import Sequence
from typing import Protocol

from sim.types import Capture, Contact, DroneState
from sim.world import World
from voxdepth.types import CorrectedDepth, FloatArray

from .team import Team
from .types import Decision, Histogram, Outcome


class Recorder(Protocol):
    """Receives everything worth seeing; never changes anything."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """The world before the first step, and who flies in it."""
        ...

    def tick(
        self, step: int, time_s: float, states: Sequence[DroneState], slots_m: FloatArray, decisions: Sequence[Decision]
    ) -> None:
        """All drones after a decision. `slots_m` has shape (n, 3): where the followers belong."""
        ...

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth, histogram: Histogram) -> None:
        """One image and what was made of it."""
        ...

    def metrics(self, step: int, time_s: float, values: dict[str, float]) -> None:
        """Figures at this moment, by name."""
        ...

    def contact(self, step: int, contact: Contact) -> None:
        """A collision."""
        ...

    def outcome(self, step: int, time_s: float, outcome: Outcome) -> None:
        """The end of the mission."""
        ...

    def close(self) -> None:
        """Finish whatever is written; a second call does nothing."""
        ...


class NullRecorder:
    """Forgets everything."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Nothing."""

    def tick(
        self, step: int, time_s: float, states: Sequence[DroneState], slots_m: FloatArray, decisions: Sequence[Decision]
    ) -> None:
        """Nothing."""

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth, histogram: Histogram) -> None:
        """Nothing."""

    def metrics(self, step: int, time_s: float, values: dict[str, float]) -> None:
        """Nothing."""

    def contact(self, step: int, contact: Contact) -> None:
        """Nothing."""

    def outcome(self, step: int, time_s: float, outcome: Outcome) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""
