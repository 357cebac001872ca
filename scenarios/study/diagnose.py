"""The diagnosis of collisions: a probe on board says what a drone had seen of the object that it hit."""

from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import replace

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
from voxdepth.types import CorrectedDepth, FloatArray, MaskImage, Source

from .causes import Cause, Diagnosis

LOOKBACK_S = 3.0
"""Time before the collision from which images are used."""
LAST_S = 1.0
"""Time before the collision in which the drone could still have stopped."""
NEAR_M = 1.0
"""Largest distance from the drone at the collision of the surface that counts as hit; of a body that moves, from where
the drone would be beside it."""
MIN_VISIBLE_SHARE = 0.2
"""Smallest share of the images that must show this surface; otherwise it counts as not in view."""


Image = tuple[Capture, CorrectedDepth]
"""An image of a drone with its true and its corrected depth."""


class CollisionProbe(Recorder):
    """Keeps the recent images of every camera, and diagnoses the first collision of each drone with these pilots."""

    def __init__(self, pilot: PilotConfig) -> None:
        self._min_confidence = pilot.min_confidence if pilot.holes == "evidenced" else 0.0
        """Confidence from which these drones trust a pixel."""
        self._images: defaultdict[int, deque[Image]] = defaultdict(deque)
        self._decisions: defaultdict[int, deque[tuple[float, Decision]]] = defaultdict(deque)
        self._world: World | None = None
        self._movers_m: deque[tuple[float, dict[int, FloatArray]]] = deque()
        """Times [s], and where the moving bodies were, by their number."""
        self._struck: set[int] = set()
        self.diagnoses: list[Diagnosis] = []
        """Of the first collision of each drone, in order of time; of two drones that touch, one for both."""

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
        """Keep the decisions of the last second, and where moving bodies were while the images were taken."""
        assert self._world is not None, "start comes first"
        self._movers_m.append((time_s, self._world.mover_positions_m()))
        while self._movers_m[0][0] < time_s - LOOKBACK_S:
            self._movers_m.popleft()
        for drone, decision in enumerate(decisions):
            recent = self._decisions[drone]
            recent.append((time_s, decision))
            while recent[0][0] < time_s - LAST_S:
                recent.popleft()

    def contact(self, step: int, contact: Contact) -> None:
        """Diagnose the first collision of a drone."""
        is_first = contact.drone not in self._struck
        self._struck.update(contact.drones)
        if is_first:
            found = Diagnosis(cause=Cause.DRONE) if contact.kind == "drone" else self._diagnosed(contact)
            self.diagnoses.append(replace(found, drone=contact.drone, time_s=contact.time_s))

    def _diagnosed(self, contact: Contact) -> Diagnosis:
        """Return the cause of a contact with what is not a drone."""
        assert self._world is not None, "start comes first"
        hit, body = next((hit, body) for hit, body in self._world.described.items() if body.name == contact.other)
        recent = [one for one in self._images[contact.drone] if one[0].stamp_s >= contact.time_s - LOOKBACK_S]
        at_m = self._world.states[contact.drone].position_m
        beside_m = [at_m + self._moved_m(hit, capture.stamp_s) for capture, _ in recent]
        found = diagnose(recent, hit, beside_m, self._min_confidence)
        struck_m, decisions = self._world.nearest_point_m(contact.drone, hit), self._decisions[contact.drone]
        held = held_at(decisions[0][1].view, struck_m) if decisions else None
        return replace(found, textureless=body.surface.is_blank, held_before=held)

    def _moved_m(self, body: int, time_s: float) -> FloatArray:
        """Return by how much a body was elsewhere than now at a time, shape (3,)."""
        assert self._world is not None, "start comes first"
        now_m = self._world.mover_positions_m().get(body)
        if now_m is None or not self._movers_m:
            return np.zeros(3)
        _, then_m = min(self._movers_m, key=lambda one: abs(one[0] - time_s))
        return then_m[body] - now_m


def held_at(view: MapView | None, point_m: FloatArray) -> str | None:
    """Return what a map holds at a point of the world, shape (3,); None without a map."""
    if view is None:
        return None
    return STATES[view.state_at(view.from_world(point_m))]


def diagnose(images: Sequence[Image], body: int, points_m: Sequence[FloatArray], min_confidence: float) -> Diagnosis:
    """Find the cause by a majority of the pixels of the surface that was hit, over all images; texture is left out.

    Args:
        images: Images of the drone before the collision.
        body: Id of the body that it hit.
        points_m: For each image, the position of the drone at the collision in the world frame, shape (3,); beside
            where the body was, if that moves.
        min_confidence: Confidence, 0..1, from which on the drone trusts a pixel.
    """
    masks = [_pixels_of(body, at_m, capture) for (capture, _), at_m in zip(images, points_m, strict=True)]
    if sum(bool(mask.any()) for mask in masks) < max(1, MIN_VISIBLE_SHARE * len(images)):
        return Diagnosis(cause=Cause.NOT_IN_VIEW)
    seen = list(zip(images, masks, strict=True))
    true_m = np.concatenate([capture.depth_true_m[mask] for (capture, _), mask in seen])
    corrected_m = np.concatenate([corrected.depth_m[mask] for (_, corrected), mask in seen])
    confidence = np.concatenate([corrected.confidence[mask] for (_, corrected), mask in seen])
    source = np.concatenate([corrected.source[mask] for (_, corrected), mask in seen])
    trusted = (confidence >= min_confidence) & (corrected_m > 0)
    if np.mean(corrected_m > 0) < 0.5:
        return Diagnosis(cause=Cause.NO_DEPTH)
    if np.mean(trusted) < 0.5:
        return Diagnosis(cause=Cause.UNTRUSTED)
    true_m, corrected_m = true_m[trusted], corrected_m[trusted]
    ratio = corrected_m / true_m
    middle = np.argsort(ratio)[ratio.size // 2]
    shown_m, at_m = round(float(corrected_m[middle]), 2), round(float(true_m[middle]), 2)  # As the text has them.
    is_measured = np.mean(source[trusted] == Source.SENSOR) >= 0.5
    too_far = Cause.MEASURED_TOO_FAR if is_measured else Cause.FILLED_TOO_FAR
    return Diagnosis(cause=too_far if shown_m > TOO_FAR * at_m else Cause.CORRECT, true_m=at_m, corrected_m=shown_m)


def _pixels_of(body: int, point_m: FloatArray, capture: Capture) -> MaskImage:
    """Return the pixels of a body within `NEAR_M` of a point of the world, shape (H, W)."""
    shown: MaskImage = capture.segment_id == body
    points_m = back_project(np.where(shown, capture.depth_true_m, np.float32(0)), capture.intrinsics)
    in_world_m = points_m @ capture.T_world_cam[:3, :3].T + capture.T_world_cam[:3, 3]
    shown[shown] = np.linalg.norm(in_world_m - point_m, axis=1) < NEAR_M
    return shown
