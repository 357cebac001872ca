"""Why swarms collided: their runs are flown again, and the drone is asked what it had seen of what it hit."""

from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from sim.types import Capture, Contact, IdImage
from sim.world import World
from swarm.recorder import Recorder
from swarm.team import Team
from swarm.types import Histogram, Outcome
from voxdepth.geometry import back_project
from voxdepth.metrics import TOO_FAR
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


class Cause(StrEnum):
    """What a drone knew of what it hit."""

    DRONE = "another drone"
    UNSEEN = "not in view"
    EMPTY = "no depth"
    DOUBTED = "depth not trusted"
    TOO_FAR = "too far away"
    SEEN = "where it was"


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """What is known of one collision."""

    cause: Cause
    on_blank: bool = False
    """Whether what was hit has no texture."""
    true_m: float | None = None
    """Median distance of the pixels that were trusted; None unless the cause is `TOO_FAR` or `SEEN`."""
    shown_m: float | None = None
    """Median of their corrected depth."""

    def __str__(self) -> str:
        distance = "" if self.true_m is None else f", shown at {self.shown_m:.2f} m instead of {self.true_m:.2f} m"
        return f"{self.cause}{distance}{'; it has no texture' if self.on_blank else ''}"


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What one image showed, and what the drone made of it."""

    stamp_s: float
    true_m: FloatImage
    """Shape (H, W); 0 where there is nothing."""
    shown_m: FloatImage
    """Corrected depth, shape (H, W); 0 where there is none."""
    trusted: MaskImage
    """Where its confidence is high enough, shape (H, W)."""
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


class Witness(Recorder):
    """Remembers what every camera showed of late, until the first collision.

    Args:
        min_confidence: Pixels of less are not trusted.
    """

    def __init__(self, min_confidence: float) -> None:
        self._min_confidence = min_confidence
        self._looks: defaultdict[int, deque[Look]] = defaultdict(deque)
        self._world: World | None = None
        self.explanation: Explanation | None = None
        """Of the first collision; None before."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """The world that flies."""
        self._world = world

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth, histogram: Histogram) -> None:
        """Keep it for a while."""
        looks = self._looks[capture.drone]
        looks.append(
            Look(
                stamp_s=capture.stamp_s,
                true_m=np.where(np.isfinite(capture.depth_true_m), capture.depth_true_m, np.float32(0)),
                shown_m=corrected.depth_m,
                trusted=corrected.confidence >= self._min_confidence,
                segment_id=capture.segment_id,
                T_world_cam=capture.T_world_cam,
                intrinsics=capture.intrinsics,
            )
        )
        while looks[0].stamp_s < capture.stamp_s - LOOKBACK_S:
            looks.popleft()

    def contact(self, step: int, contact: Contact) -> None:
        """Judge the first one."""
        if self.explanation is None:
            assert self._world is not None, "start comes first"
            self.explanation = self._judge(contact, self._world)

    def _judge(self, contact: Contact, world: World) -> Explanation:
        if contact.kind == "drone":
            return Explanation(cause=Cause.DRONE)
        hit, body = next((hit, body) for hit, body in world.described.items() if body.name == contact.other)
        recent = [look for look in self._looks[contact.drone] if look.stamp_s >= contact.time_s - LOOKBACK_S]
        found = explanation_of(recent, hit, world.states[contact.drone].position_m)
        return replace(found, on_blank=body.surface.texture == 0)


def explanation_of(looks: Sequence[Look], body: int, point_m: FloatArray) -> Explanation:
    """What most pixels of what was hit looked like, over all images that showed it; not whether it has a texture.

    Args:
        looks: Those of the last seconds.
        body: Which was hit.
        point_m: Where the drone was, shape (3,).
    """
    masks = [look.of_body_near(body, point_m) for look in looks]
    if sum(bool(mask.any()) for mask in masks) < max(1, LOOKED_SHARE * len(looks)):
        return Explanation(cause=Cause.UNSEEN)
    pixels = [
        (look.true_m[mask], look.shown_m[mask], look.trusted[mask]) for look, mask in zip(looks, masks, strict=True)
    ]
    true_m, shown_m, trusted = (np.concatenate(parts) for parts in zip(*pixels, strict=True))
    trusted &= shown_m > 0
    if np.mean(shown_m > 0) < 0.5:
        return Explanation(cause=Cause.EMPTY)
    if np.mean(trusted) < 0.5:
        return Explanation(cause=Cause.DOUBTED)
    true_m, shown_m = true_m[trusted], shown_m[trusted]
    return Explanation(
        cause=Cause.TOO_FAR if np.median(shown_m / true_m) > TOO_FAR else Cause.SEEN,
        true_m=float(np.median(true_m)),
        shown_m=float(np.median(shown_m)),
    )


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


def explanations(
    contents: Contents,
    cells: Mapping[str, Sequence[RunSpec]],
    workers: int,
    tell: Callable[[RunSpec, Explanation], None],
) -> Mapping[str, Sequence[Explanation]]:
    """Fly runs again that ended in a collision, and find the cause of each, by arm; `tell` hears of each.

    Raises:
        ScenarioError: A run does not end as it did.
    """
    listed = [spec for specs in cells.values() for spec in specs]
    found: dict[str, list[Explanation]] = {arm: [] for arm in cells}
    flown = in_processes(_fly, [spec.run for spec in listed], workers=workers)
    for spec, (explanation, contacts) in zip(listed, flown, strict=True):
        if explanation is None or contacts != contents.records[spec.key].contacts:
            raise ScenarioError(
                f"{spec.label} did not collide as in the study, which was flown with {contents.versions}: compare "
                f"with voxdepth study replay OUT {spec.short_key}"
            )
        found[spec.arm].append(explanation)
        tell(spec, explanation)
    return found


def as_table(found: Mapping[str, Sequence[Explanation]]) -> Table:
    """A row for each arm."""
    seen = [f"seen: {cause}" for cause in Cause if cause is not Cause.DRONE]
    head = ["arm", "collisions", f"hit: {Cause.DRONE}", "hit: without texture", *seen]
    return Table(head, [_row(arm, listed) for arm, listed in found.items()])


def _row(arm: str, found: Sequence[Explanation]) -> list[str]:
    causes = Counter(explanation.cause for explanation in found)
    counts = [len(found), causes[Cause.DRONE], sum(explanation.on_blank for explanation in found)]
    counts += [causes[cause] for cause in Cause if cause is not Cause.DRONE]
    return [arm, *map(str, counts)]


def _fly(run: Run) -> tuple[Explanation | None, tuple[Contact, ...]]:
    witness = Witness(run.scenario.mission.pilot.avoidance.histogram.min_confidence)
    with flying(run, witness, recorded=False, threads=1) as mission:
        result = mission.run()
    return witness.explanation, result.contacts
