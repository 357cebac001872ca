"""Views: what is kept of frames, each with the memory of that time, so that the camera can be tracked from there."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..arithmetic import matmul
from ..geometry import transform
from ..types import FloatArray, GrayImage
from .memory import Memory
from .relocalisation import Landmarks
from .tracking_camera import Pixels, TrackingCamera

MAX_STORED = 4
"""Number of stored views, of which the oldest is dropped first."""
MIN_OVERLAP = 0.6
"""Share of the corners of the first view of a scene that remain visible; when fewer do, a new scene begins."""


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A frame from which the camera can be tracked."""

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
    T_view_previous: FloatArray | None
    """Motion since the keyframe before; None if that is unknown. It predicts the next motion."""


class Views:
    """The keyframe, which is the view that the camera is tracked from, and a few stored views of earlier scenes.

    A keyframe is stored when the camera sees another scene than at the one stored before, and when tracking leaves it.
    """

    def __init__(self, camera: TrackingCamera) -> None:
        self._camera = camera
        self._stored: deque[View] = deque(maxlen=MAX_STORED)
        self._T_keyframe_first: FloatArray = np.eye(4)
        self.keyframe: View | None = None

    @property
    def stored(self) -> list[View]:
        """The stored views except the keyframe, the latest first."""
        return [view for view in reversed(self._stored) if view is not self.keyframe]

    def add(self, view: View) -> None:
        """Make a view of the newest frame the keyframe."""
        if view.T_view_previous is None:
            self._leave()
            self._begin_scene(view)
        else:
            self._T_keyframe_first = matmul(view.T_view_previous, self._T_keyframe_first)
            seen = self._camera.sees(transform(self._T_keyframe_first, self._first.points_m))
            if np.count_nonzero(seen) <= MIN_OVERLAP * len(seen):
                self._stored.append(view)
                self._begin_scene(view)
        self.keyframe = view

    def return_to(self, view: View) -> None:
        """Make the keyframe or a stored view the keyframe, because the camera sees that scene again."""
        if view is not self.keyframe:
            self._stored.remove(view)
            self._leave()
            self.keyframe = view
            self._begin_scene(view)

    def _leave(self) -> None:
        """Store the keyframe if more than one frame contributed to its memory."""
        leaving = self.keyframe
        if leaving is not None and leaving.T_view_previous is not None and leaving not in self._stored:
            self._stored.append(leaving)

    def _begin_scene(self, first: View) -> None:
        self._first = first
        self._T_keyframe_first = np.eye(4)
