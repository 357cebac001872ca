"""Why swarms collided: their runs are flown again, and the drone is asked what it had seen of what it hit."""

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim.types import Capture, Contact, IdImage
from sim.world import World
from swarm.recorder import NullRecorder
from swarm.team import Team
from swarm.types import Histogram, Outcome
from voxdepth.geometry import back_project
from voxdepth.types import CorrectedDepth, FloatArray, FloatImage, Intrinsics, MaskImage

from ..batch import in_processes
from ..config import Run
from ..errors import ScenarioError
from ..runner import flying
from .matrix import RunSpec
from .store import Contents
from .tables import Table

LOOKBACK_S = 3.0
"""What was seen earlier explains nothing."""
NEAR_M = 1.0
"""How far a surface may be from the middle of the drone at the touch to belong to what was hit."""
LOOKED_SHARE = 0.2
"""Share of the images of that time in which it must be visible, or the drone looked elsewhere."""
TOO_FAR = 1.1
"""Ratio of corrected to true depth above which a surface was seen too far away."""


class Cause(StrEnum):
    """What a drone knew of what it hit."""

    DRONE = "another drone"
    UNSEEN = "not in view"
    HOLE = "a hole"
    TOO_FAR = "too far away"
    SEEN = "where it was"


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What one image showed, and what the drone made of it."""

    stamp_s: float
    true_m: FloatImage
    """Shape (H, W); 0 where there is nothing."""
    trusted_m: FloatImage
    """Corrected depth, shape (H, W); 0 where there is none or its confidence is too low."""
    segment_id: IdImage
    T_world_cam: FloatArray
    intrinsics: Intrinsics

    def of_body_near(self, body: int, point_m: FloatArray) -> MaskImage:
        """Pixels of a body within `NEAR_M` of a point of the world, shape (H, W)."""
        shown: MaskImage = (self.segment_id == body) & (self.true_m > 0)
        points_m = back_project(np.where(shown, self.true_m, np.float32(0)), self.intrinsics)
        in_world_m = points_m @ self.T_world_cam[:3, :3].T + self.T_world_cam[:3, 3]
        shown[shown] = np.linalg.norm(in_world_m - point_m, axis=1) < NEAR_M
        return shown


class Witness(NullRecorder):
    """Remembers what every camera showed of late, until the first collision.

    Args:
        min_confidence: Pixels of less count as holes.
    """

    def __init__(self, min_confidence: float) -> None:
        self._min_confidence = min_confidence
        self._looks: defaultdict[int, deque[Look]] = defaultdict(deque)
        self._world: World | None = None
        self.cause: Cause | None = None
        """Of the first collision; None before."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """The world that flies."""
        self._world = world

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth, histogram: Histogram) -> None:
        """Keep it for a while."""
        looks = self._looks[capture.drone]
        trusted = corrected.confidence >= self._min_confidence
        looks.append(
            Look(
                stamp_s=capture.stamp_s,
                true_m=np.where(np.isfinite(capture.depth_true_m), capture.depth_true_m, np.float32(0)),
                trusted_m=np.where(trusted, corrected.depth_m, np.float32(0)),
                segment_id=capture.segment_id,
                T_world_cam=capture.T_world_cam,
                intrinsics=capture.intrinsics,
            )
        )
        while looks[0].stamp_s < capture.stamp_s - LOOKBACK_S:
            looks.popleft()

    def contact(self, step: int, contact: Contact) -> None:
        """Judge the first one."""
        if self.cause is None:
            assert self._world is not None, "start comes first"
            self.cause = self._judge(contact, self._world)

    def _judge(self, contact: Contact, world: World) -> Cause:
        if contact.kind == "drone":
            return Cause.DRONE
        body = next(body_id for body_id, body in world.described.items() if body.name == contact.other)
        recent = [look for look in self._looks[contact.drone] if look.stamp_s >= contact.time_s - LOOKBACK_S]
        return cause_of(recent, body, world.states[contact.drone].position_m)


def cause_of(looks: Sequence[Look], body: int, point_m: FloatArray) -> Cause:
    """What most pixels of what was hit looked like, over all images that showed it.

    Args:
        looks: Those of the last seconds.
        body: Which was hit.
        point_m: Where the drone was, shape (3,).
    """
    masks = [look.of_body_near(body, point_m) for look in looks]
    if sum(bool(mask.any()) for mask in masks) < max(1, LOOKED_SHARE * len(looks)):
        return Cause.UNSEEN
    true_m = np.concatenate([look.true_m[mask] for look, mask in zip(looks, masks, strict=True)])
    trusted_m = np.concatenate([look.trusted_m[mask] for look, mask in zip(looks, masks, strict=True)])
    if np.mean(trusted_m > 0) < 0.5:
        return Cause.HOLE
    known = trusted_m > 0
    return Cause.TOO_FAR if np.median(trusted_m[known] / true_m[known]) > TOO_FAR else Cause.SEEN


def collided(contents: Contents, arms: Sequence[str], most: int | None) -> Mapping[str, Sequence[RunSpec]]:
    """Cells whose runs ended in a collision, by arm, in the order of the seeds.

    Args:
        contents: The study.
        arms: Their names; all if there are none.
        most: The first so many of each arm; None for all.

    Raises:
        ScenarioError: An arm is not one of the study.
    """
    found: dict[str, list[RunSpec]] = {arm.name: [] for arm in contents.study.arms}
    for arm in arms:
        if arm not in found:
            raise ScenarioError(f"the study has no arm {arm!r}: choose from {', '.join(found)}")
    for spec in contents.cells:
        if spec.key in contents.records and contents.records[spec.key].outcome is Outcome.COLLISION:
            found[spec.arm].append(spec)
    return {arm: specs[:most] for arm, specs in found.items() if not arms or arm in arms}


def causes(
    contents: Contents,
    cells: Mapping[str, Sequence[RunSpec]],
    workers: int,
    tell: Callable[[RunSpec, Cause], None],
) -> Mapping[str, Counter[Cause]]:
    """Fly runs again that ended in a collision, and count the causes by arm; `tell` hears of each.

    Raises:
        ScenarioError: A run does not end as it did.
    """
    listed = [spec for specs in cells.values() for spec in specs]
    found: dict[str, Counter[Cause]] = {arm: Counter() for arm in cells}
    flown = in_processes(_fly, [spec.run for spec in listed], workers=workers)
    for spec, (cause, contacts) in zip(listed, flown, strict=True):
        if cause is None or contacts != contents.records[spec.key].contacts:
            raise ScenarioError(
                f"{spec.label} did not collide as in the study, which was flown with {contents.versions}: compare "
                f"with voxdepth study replay OUT {spec.key[:12]}"
            )
        found[spec.arm][cause] += 1
        tell(spec, cause)
    return found


def as_table(found: Mapping[str, Counter[Cause]]) -> Table:
    """A row for each arm."""
    head = ["arm", "collisions", *(f"hit: {cause}" if cause is Cause.DRONE else f"seen: {cause}" for cause in Cause)]
    return Table(head, [_row(arm, counts) for arm, counts in found.items()])


def _row(arm: str, counts: Counter[Cause]) -> list[str]:
    return [arm, str(counts.total()), *(str(counts[cause]) for cause in Cause)]


def _fly(run: Run) -> tuple[Cause | None, tuple[Contact, ...]]:
    witness = Witness(run.scenario.mission.pilot.avoidance.histogram.min_confidence)
    with flying(run, witness, recorded=False, threads=1) as mission:
        result = mission.run()
    return witness.cause, result.contacts
