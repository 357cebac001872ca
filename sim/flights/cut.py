"""A film with scene cuts."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import count
from typing import Literal

from pydantic import Field

from voxdepth.types import FloatArray

from ..errors import SceneError
from ..seeds import Purpose, stream
from ..types import BodyPose
from .motion import Flight, Motion, require_rate
from .walk import Walk

NEAREST_JUMP = 0.25
"""Shortest jump, as a share of the walk without its last take."""
CUT_STREAM = 1


class Cut(Flight):
    """A walk cut into takes that follow each other at random: each goes on from another place of the path.

    Begins at the start of the path and has as many frames as the walk.
    """

    kind: Literal["cut"] = "cut"
    walk: Walk = Walk()
    every: int = Field(15, ge=1)
    """Frames per take: the camera jumps at each multiple of it."""

    def poses(self, path_m: FloatArray, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        """Takes of the walk; see `Flight`."""
        require_rate(rate_hz)
        track = self.walk.track(path_m)
        duration_s = self.walk.duration_s(track)
        shortest_s = 2 * self.every / rate_hz
        if duration_s < shortest_s:
            raise SceneError(
                f"takes of {self.every} frames at {rate_hz:g} Hz need a walk of at least {shortest_s:g} s, "
                f"got one of {duration_s:.3g} s; choose a longer path or cut more often"
            )
        return self._takes(self.walk.motion(track, seed), duration_s, seed, rate_hz)

    def _takes(self, motion: Motion, duration_s: float, seed: int, rate_hz: float) -> Iterator[BodyPose]:
        rng = stream(seed, Purpose.FLIGHT, CUT_STREAM)
        take_s = self.every / rate_hz
        latest_s = duration_s - take_s
        shift_s = 0.0
        for k in count():
            time_s = k / rate_hz
            if time_s > duration_s:
                return
            if k > 0 and k % self.every == 0:
                jump_s = rng.uniform(NEAREST_JUMP, 1 - NEAREST_JUMP) * latest_s
                shift_s = (time_s + shift_s + jump_s) % latest_s - time_s
            yield replace(motion(time_s + shift_s), stamp_s=time_s)
