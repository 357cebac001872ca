"""What a mission reports while it runs."""

from collections.abc import Sequence

from sim.types import Capture, Contact, DroneState
from sim.world import World
from voxdepth.types import CorrectedDepth

from .pilot import Decision
from .team import Team
from .types import Outcome


class Recorder:
    """Receives everything that happens in a mission and discards it; subclasses override the calls that they need."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Receive the world before the first step, and the swarms."""

    def tick(self, step: int, time_s: float, states: Sequence[DroneState], decisions: Sequence[Decision]) -> None:
        """Receive all drones after a decision.

        Args:
            step: Number of steps of physics up to now.
            time_s: Simulated time.
            states: Motion of each drone when it decided.
            decisions: Decision of each drone, which the next step begins to follow.
        """

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Receive one image and its corrected depth, at the latest before the next image, a contact and the end."""

    def metrics(self, step: int, time_s: float, values: dict[str, float]) -> None:
        """Receive the present metrics by name."""

    def contact(self, step: int, contact: Contact) -> None:
        """Receive a collision."""

    def outcome(self, step: int, time_s: float, outcome: Outcome) -> None:
        """Receive the end of the mission."""

    def close(self) -> None:
        """Finish what is being written; a second call does nothing."""


class CaptureRecorder(Recorder):
    """Keeps the newest capture of each drone with its corrected depth."""

    def __init__(self) -> None:
        self.newest: dict[int, tuple[Capture, CorrectedDepth]] = {}

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Keep a capture."""
        self.newest[capture.drone] = capture, corrected
