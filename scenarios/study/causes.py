"""Why a drone collided: what its images and its map held of what it hit."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

from swarm.map.voxel_map import STATES
from voxdepth.tools.results.table import Table, Value


class Cause(StrEnum):
    """What the depth images showed of the object that the drone hit."""

    DRONE = "another drone"
    NOT_IN_VIEW = "not in view"
    NO_DEPTH = "no depth"
    UNTRUSTED = "depth not trusted"
    FILLED_TOO_FAR = "filled too far away"
    MEASURED_TOO_FAR = "measured too far away"
    CORRECT = "where it was"


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The cause of one collision."""

    cause: Cause
    drone: int | None = None
    """The drone that collided."""
    time_s: float | None = None
    """Simulated time of the contact [s]."""
    textureless: bool = False
    """Whether the object that was hit has no texture."""
    true_m: float | None = None
    """True depth [m] of the trusted pixel whose ratio of depths is the median, by which depths that are too far and
    correct ones are distinguished; None for other causes."""
    corrected_m: float | None = None
    """Corrected depth of the same pixel [m]."""
    held_before: str | None = None
    """What the map of the drone held there a second before, one of `STATES`; None without a map."""

    def __str__(self) -> str:
        parts = [str(self.cause)]
        if self.true_m is not None:
            parts[0] += f", shown at {self.corrected_m:.2f} m instead of {self.true_m:.2f} m"
        if self.textureless:
            parts.append("it has no texture")
        if self.held_before is not None:
            parts.append(f"map: {self.held_before} a second before")
        return "; ".join(parts)


@dataclass(frozen=True, kw_only=True)
class Diagnosed:
    """The collisions of a run that was flown again and ended as before."""

    key: str
    collisions: tuple[Diagnosis, ...]
    """One for each drone that collided, in order of time; of two drones that touch, one for both."""
    versions: Mapping[str, str] = field(compare=False)
    """What the run was flown with again."""


TOTALS = ("arm", "flights", "collisions")
CAUSE_NOTE = (
    "Of flights that were flown again with a probe on board (voxdepth study replay): a row counts the first contact of "
    "each drone. Seen is what the images of the last three seconds showed of the struck place, by most of its pixels; "
    "the map is that of the drone, a second before. What no collision had has no column."
)


def cause_table(found: Mapping[str, Sequence[Diagnosed]]) -> Table:
    """Count the causes in a row for each arm that has flights, and in a column for each cause that a collision had."""
    rows: list[dict[str, Value]] = []
    for arm, flights in found.items():
        collisions = [one for flight in flights for one in flight.collisions]
        causes, held = Counter(one.cause for one in collisions), Counter(one.held_before for one in collisions)
        counts = {
            f"hit: {Cause.DRONE}": causes[Cause.DRONE],
            "hit: without texture": sum(one.textureless for one in collisions),
            **{f"seen: {cause}": causes[cause] for cause in Cause if cause is not Cause.DRONE},
            **{f"map a second before: {state}": held[state] for state in STATES},
        }
        rows.append({"arm": arm, "flights": len(flights), "collisions": len(collisions), **counts})
    heads = [head for head in (rows[0] if rows else TOTALS) if head in TOTALS or any(row[head] for row in rows)]
    return Table.of("Causes of collisions", heads, [[row[head] for head in heads] for row in rows], note=CAUSE_NOTE)
