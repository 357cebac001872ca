"""The diagnosis of a collision: a probe on board says what the drone had seen of the object that it hit."""

from collections import Counter, defaultdict, deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from sim.types import Capture, Contact, DroneState
from sim.world import World
from swarm.map.voxel_map import STATES
from swarm.pilot import Decision, PilotConfig
from swarm.recorder import Recorder
from swarm.team import Team
from swarm.types import MapView
from voxdepth.geometry import back_project
from voxdepth.metrics import TOO_FAR
from voxdepth.tools.table import Table, Value
from voxdepth.types import CorrectedDepth, FloatArray, MaskImage

LOOKBACK_S = 3.0
"""Time before the collision from which images are used."""
LAST_S = 1.0
"""Time before the collision in which the drone could still have stopped."""
NEAR_M = 1.0
"""Largest distance from the drone at the collision of the surface that counts as hit."""
MIN_VISIBLE_SHARE = 0.2
"""Smallest share of the images that must show this surface; otherwise it counts as not in view."""


class Cause(StrEnum):
    """What the depth images showed of the object that the drone hit."""

    DRONE = "another drone"
    NOT_IN_VIEW = "not in view"
    NO_DEPTH = "no depth"
    UNTRUSTED = "depth not trusted"
    TOO_FAR = "too far away"
    CORRECT = "where it was"


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """The cause of one collision."""

    cause: Cause
    textureless: bool = False
    """Whether the object that was hit has no texture."""
    true_m: float | None = None
    """True depth [m] of the trusted pixel whose ratio of depths is the median, by which `TOO_FAR` and `CORRECT` are
    told apart; None for other causes."""
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


Image = tuple[Capture, CorrectedDepth]
"""An image of a drone with its true and its corrected depth."""


class CollisionProbe(Recorder):
    """Keeps the recent images of every camera, and diagnoses the first collision of drones with these pilots."""

    def __init__(self, pilot: PilotConfig) -> None:
        self._min_confidence = pilot.min_confidence if pilot.holes == "evidenced" else 0.0
        """Confidence from which these drones trust a pixel."""
        self._images: defaultdict[int, deque[Image]] = defaultdict(deque)
        self._decisions: defaultdict[int, deque[tuple[float, Decision]]] = defaultdict(deque)
        self._world: World | None = None
        self.diagnosis: Diagnosis | None = None
        """Diagnosis of the first collision; None before it."""

    def start(self, world: World, teams: Sequence[Team]) -> None:
        """Keep the world of the mission."""
        self._world = world

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        """Keep an image for `LOOKBACK_S`."""
        recent = self._images[capture.drone]
        recent.append((capture, corrected))
        while recent[0][0].stamp_s < capture.stamp_s - LOOKBACK_S:
            recent.popleft()

    def tick(self, step: int, time_s: float, states: Sequence[DroneState], decisions: Sequence[Decision]) -> None:
        """Keep the decisions of the last second."""
        for drone, decision in enumerate(decisions):
            recent = self._decisions[drone]
            recent.append((time_s, decision))
            while recent[0][0] < time_s - LAST_S:
                recent.popleft()

    def contact(self, step: int, contact: Contact) -> None:
        """Diagnose the first collision."""
        if self.diagnosis is not None:
            return
        if contact.kind == "drone":
            self.diagnosis = Diagnosis(cause=Cause.DRONE)
            return
        assert self._world is not None, "start comes first"
        hit, body = next((hit, body) for hit, body in self._world.described.items() if body.name == contact.other)
        recent = [one for one in self._images[contact.drone] if one[0].stamp_s >= contact.time_s - LOOKBACK_S]
        found = diagnose(recent, hit, self._world.states[contact.drone].position_m, self._min_confidence)
        struck_m, decisions = self._world.nearest_point_m(contact.drone, hit), self._decisions[contact.drone]
        held = held_at(decisions[0][1].view, struck_m) if decisions else None
        self.diagnosis = replace(found, textureless=body.surface.is_blank, held_before=held)


def held_at(view: MapView | None, place_m: FloatArray) -> str | None:
    """Return what a map holds at a place of the world, shape (3,); None without a map."""
    if view is None:
        return None
    return STATES[view.state_at(view.place(place_m))]


def diagnose(images: Sequence[Image], body: int, point_m: FloatArray, min_confidence: float) -> Diagnosis:
    """Find the cause by a majority of the pixels of the surface that was hit, over all images; texture is left out.

    `body` was hit by a drone at `point_m` [m], shape (3,). The drone trusts pixels from `min_confidence` on.
    """
    masks = [_pixels_of(body, point_m, capture) for capture, _ in images]
    if sum(bool(mask.any()) for mask in masks) < max(1, MIN_VISIBLE_SHARE * len(images)):
        return Diagnosis(cause=Cause.NOT_IN_VIEW)
    seen = list(zip(images, masks, strict=True))
    true_m = np.concatenate([capture.depth_true_m[mask] for (capture, _), mask in seen])
    corrected_m = np.concatenate([corrected.depth_m[mask] for (_, corrected), mask in seen])
    confidence = np.concatenate([corrected.confidence[mask] for (_, corrected), mask in seen])
    trusted = (confidence >= min_confidence) & (corrected_m > 0)
    if np.mean(corrected_m > 0) < 0.5:
        return Diagnosis(cause=Cause.NO_DEPTH)
    if np.mean(trusted) < 0.5:
        return Diagnosis(cause=Cause.UNTRUSTED)
    true_m, corrected_m = true_m[trusted], corrected_m[trusted]
    ratio = corrected_m / true_m
    middle = np.argsort(ratio)[ratio.size // 2]
    shown_m, at_m = round(float(corrected_m[middle]), 2), round(float(true_m[middle]), 2)  # As the text has them.
    return Diagnosis(
        cause=Cause.TOO_FAR if shown_m > TOO_FAR * at_m else Cause.CORRECT, true_m=at_m, corrected_m=shown_m
    )


def _pixels_of(body: int, point_m: FloatArray, capture: Capture) -> MaskImage:
    """Return the pixels of a body within `NEAR_M` of a point of the world, shape (H, W)."""
    shown: MaskImage = capture.segment_id == body
    points_m = back_project(np.where(shown, capture.depth_true_m, np.float32(0)), capture.intrinsics)
    in_world_m = points_m @ capture.T_world_cam[:3, :3].T + capture.T_world_cam[:3, 3]
    shown[shown] = np.linalg.norm(in_world_m - point_m, axis=1) < NEAR_M
    return shown


def cause_table(found: Mapping[str, Sequence[Diagnosis]]) -> Table:
    """Count the causes in a row for each arm."""
    seen = [cause for cause in Cause if cause is not Cause.DRONE]
    head = ["arm", "collisions", f"hit: {Cause.DRONE}", "hit: without texture"]
    maps = [f"map a second before: {state}" for state in STATES]
    rows: list[list[Value]] = []
    for arm, diagnoses in found.items():
        causes = Counter(diagnosis.cause for diagnosis in diagnoses)
        textureless = sum(diagnosis.textureless for diagnosis in diagnoses)
        held = Counter(diagnosis.held_before for diagnosis in diagnoses)
        row: list[Value] = [arm, len(diagnoses), causes[Cause.DRONE], textureless, *(causes[cause] for cause in seen)]
        rows.append([*row, *(held[state] for state in STATES)])
    return Table.of("Causes of collisions", [*head, *(f"seen: {cause}" for cause in seen), *maps], rows)
