"""Keyframes: frames to which the camera can be tracked, each with the memory of that time."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..geometry import transform
from ..types import FloatArray, GrayImage
from .memory import Memory
from .relocalisation import Landmarks
from .tracking_camera import Pixels, TrackingCamera

MAX_STORED = 4
"""Number of stored keyframes, of which the oldest is dropped first."""
MIN_OVERLAP = 0.6
"""Share of the corners of a view that remain visible; when fewer do, a new view begins."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Keyframe:
    """A frame to which the camera can be tracked."""

    gray: GrayImage
    """The tracking image."""
    corners: Pixels
    """Corners of the tracking image that have a depth, shape (N, 2)."""
    points_m: FloatArray
    """The same corners in the camera frame, shape (N, 3)."""
    landmarks: Callable[[], Landmarks]
    """Features for relocalisation, which are computed at the first call."""
    memory: Memory
    """The memory after this frame."""
    T_world_cam: FloatArray | None
    T_keyframe_previous: FloatArray | None
    """Motion since the keyframe before; None if that is unknown. It predicts the next motion."""


class Keyframes:
    """The current keyframe, and a few keyframes of earlier views.

    A keyframe is stored when the view has changed since the one stored before, and when tracking leaves it.
    """

    def __init__(self, camera: TrackingCamera) -> None:
        self._camera = camera
        self._stored: deque[Keyframe] = deque(maxlen=MAX_STORED)
        self._T_current_view: FloatArray = np.eye(4)
        self.current: Keyframe | None = None

    @property
    def stored(self) -> list[Keyframe]:
        """The stored keyframes except the current one, the latest first."""
        return [keyframe for keyframe in reversed(self._stored) if keyframe is not self.current]

    def add(self, keyframe: Keyframe) -> None:
        """Make a keyframe the current one."""
        if keyframe.T_keyframe_previous is None:
            self._leave()
            self._begin_view(keyframe)
        else:
            self._T_current_view = keyframe.T_keyframe_previous @ self._T_current_view
            seen = self._camera.sees(transform(self._T_current_view, self._view.points_m))
            if np.count_nonzero(seen) <= MIN_OVERLAP * len(seen):
                self._stored.append(keyframe)
                self._begin_view(keyframe)
        self.current = keyframe

    def return_to(self, keyframe: Keyframe) -> None:
        """Make the current or a stored keyframe the current one, because the camera sees that view again."""
        if keyframe is not self.current:
            self._stored.remove(keyframe)
            self._leave()
            self.current = keyframe
            self._begin_view(keyframe)

    def _leave(self) -> None:
        """Store the current keyframe if more than one frame contributed to its memory."""
        leaving = self.current
        if leaving is not None and leaving.T_keyframe_previous is not None and leaving not in self._stored:
            self._stored.append(leaving)

    def _begin_view(self, keyframe: Keyframe) -> None:
        self._view = keyframe
        self._T_current_view = np.eye(4)
