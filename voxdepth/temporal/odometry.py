"""Where the camera is against the last frame that could be placed: by tracks, and by what leads back to them."""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import cv2
import numpy as np
from pydantic import Field

from ..geometry import inverse_rigid, resized
from ..model import Model
from ..paper.registration import OrbRegistration, RegistrationConfig
from ..types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics
from .feature_tracker import Points, Tracks, TracksConfig, View
from .pose_fit import Fit, Pinhole, fit_pose
from .working_resolution import Scale


class LocalisationConfig(Model):
    """When a pose is believed."""

    tracks: TracksConfig = TracksConfig()
    min_tracks: int = Field(12, ge=6)
    """Corners with depth that must be found again; an image with fewer corners shows nothing to go by."""
    min_inlier_share: float = Field(0.5, gt=0, le=1)
    """Least share of the tracks that one rigid motion explains. Good poses have 0.74 and more, wrong ones 0.1."""
    inlier_px: float = Field(1.0, gt=0)
    """Distance up to which a track supports the motion, in pixels of the reduced image."""
    max_residual_px: float = Field(1.5, gt=0)
    """Largest median distance of the tracks. Good poses have at most 1, wrong ones at least 14."""


class TrackingStatus(StrEnum):
    """How the search for the camera went."""

    FIRST_FRAME = "first_frame"
    """There is no earlier frame."""
    OK = "ok"
    """Its motion since the last frame that was placed is known."""
    NO_FEATURES = "no_features"
    """Too few corners to tell anything: darkness, fog, a covered lens, a blank wall."""
    LOST = "lost"
    """There are corners, and they are not those of the earlier frame: a cut, or too long a gap."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Location:
    """Where the camera is."""

    found: TrackingStatus
    view: View
    """What was looked at."""
    T_now_before: FloatArray
    """Motion since the last frame that was placed, shape (4, 4); the identity unless `found` is `OK`."""
    tracks: int = 0
    """Corners that were looked for."""
    inliers: int = 0
    """Those that support the motion."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Placed:
    """The last frame whose place is known."""

    view: View
    gray: GrayImage
    points_m: FloatArray
    """Of the corners that have a depth, in its camera, shape (N, 3)."""
    corners: Points
    T_world_cam: FloatArray | None
    T_now_before: FloatArray
    """Motion that led to it; the identity if none is known. The next one may be much like it."""


class Localisation:
    """Finds the motion between frames.

    Corners start where the last motion would take them, then where they were, then where features (ORB) and then where
    phase correlation say that the image went. Those only say where to look: what is believed is decided by the fit.
    A caller's pose, if there is one, is where the search starts, and stands if the image shows nothing to go by.
    """

    def __init__(self, camera: Intrinsics, scale: Scale, config: LocalisationConfig) -> None:
        self._config = config
        self._scale = scale
        self._tracks = Tracks(camera, config.tracks)
        small = self._tracks.scale
        self._lens = Pinhole(
            fx_px=camera.fx_px * small,
            fy_px=camera.fy_px * small,
            cx_px=resized(camera.cx_px, small),
            cy_px=resized(camera.cy_px, small),
        )
        self._features = OrbRegistration(RegistrationConfig(), camera.shape)
        self.reset()

    def reset(self) -> None:
        """Forget all frames."""
        self._before: _Placed | None = None

    def locate(self, frame: Frame) -> Location:
        """Where the camera is. Nothing is kept until `place`."""
        view, before = self._tracks.view(frame.gray), self._before
        if before is None:
            return Location(found=TrackingStatus.FIRST_FRAME, view=view, T_now_before=np.eye(4))
        tracks, prior = len(before.corners), _relative(before, frame)
        for expected, T_start in self._starts(before, frame, view, prior):
            fit = self._fit(before, view, expected, T_start)
            if fit is not None:
                T, inliers = fit.T_target_source, fit.inliers
                return Location(found=TrackingStatus.OK, view=view, T_now_before=T, tracks=tracks, inliers=inliers)
        if prior is not None:
            return Location(found=TrackingStatus.OK, view=view, T_now_before=prior, tracks=tracks)
        found = TrackingStatus.NO_FEATURES if len(view.corners) < self._config.min_tracks else TrackingStatus.LOST
        return Location(found=found, view=view, T_now_before=np.eye(4), tracks=tracks)

    def place(self, frame: Frame, location: Location, disparity_px: FloatImage) -> None:
        """Make a frame the one that the next is compared with.

        Args:
            frame: Copied as far as it is kept.
            location: What `locate` said of it.
            disparity_px: What is known of its depth, at the memory's size; 0 = nothing.
        """
        scale, small = self._scale, self._tracks.scale * self._scale.step
        corners = location.view.corners
        col, row = np.rint(resized(corners, 1 / small)).astype(np.intp).T
        known_px = disparity_px[np.clip(row, 0, scale.height_px - 1), np.clip(col, 0, scale.width_px - 1)]
        corners, known_px = corners[known_px > 0], known_px[known_px > 0]
        z = scale.focal_baseline_px_m / known_px.astype(np.float64)
        lens = self._lens
        x, y = (corners[:, 0] - lens.cx_px) * z / lens.fx_px, (corners[:, 1] - lens.cy_px) * z / lens.fy_px
        self._before = _Placed(
            view=location.view,
            gray=frame.gray.copy(),
            points_m=np.stack([x, y, z], axis=1),
            corners=corners,
            T_world_cam=frame.T_world_cam,
            T_now_before=location.T_now_before,
        )

    def _starts(
        self, before: _Placed, frame: Frame, view: View, prior: FloatArray | None
    ) -> Iterator[tuple[Points, FloatArray]]:
        """Where the corners may be, the likeliest first; each costs something only when it is asked for."""
        if len(before.corners) < self._config.min_tracks:
            return
        for T in [before.T_now_before, np.eye(4)] if prior is None else [prior]:
            moved = before.points_m @ T[:3, :3].T + T[:3, 3]
            yield self._lens.project(moved).astype(np.float32), T
        ones = np.ones((len(before.corners), 1))
        M = self._features.register(self._features.describe(before.gray), self._features.describe(frame.gray))
        if M.ok:
            small = self._tracks.scale
            moved = np.hstack([resized(before.corners, 1 / small), ones]) @ M.M_frame_template.T
            yield resized(moved, small).astype(np.float32), np.eye(4)
        earlier, later = (each.gray.astype(np.float32) for each in (before.view, view))
        shift, _ = cv2.phaseCorrelate(earlier, later, cv2.createHanningWindow(earlier.shape[::-1], cv2.CV_32F))
        yield before.corners + np.asarray(shift, np.float32), np.eye(4)

    def _fit(self, before: _Placed, view: View, expected: Points, T_start: FloatArray) -> Fit | None:
        """The motion that the tracks show; None if it cannot be believed."""
        config = self._config
        seen, found = self._tracks.follow(before.view, view, before.corners, expected)
        if np.count_nonzero(found) < config.min_tracks:
            return None
        fit = fit_pose(before.points_m[found], seen[found].astype(np.float64), self._lens, T_start, config.inlier_px)
        good = fit.inlier_share >= config.min_inlier_share and fit.residual_px <= config.max_residual_px
        return fit if good and fit.inliers >= config.min_tracks else None


def _relative(before: _Placed, frame: Frame) -> FloatArray | None:
    """The motion by the caller's poses; None unless both frames have one."""
    if before.T_world_cam is None or frame.T_world_cam is None:
        return None
    T: FloatArray = inverse_rigid(frame.T_world_cam) @ before.T_world_cam
    return T
