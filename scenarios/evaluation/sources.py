"""Where the frames of an evaluation come from, each with its reference: true depth, or pixels that are held out."""

import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim.recording import Recording
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.metrics import SeenBefore
from voxdepth.types import FloatArray, FloatImage, Frame, GrayImage, Intrinsics, MaskImage

from ..errors import ScenarioError
from ..files import as_scenario_error
from ..sequences import moving_ids
from .groups import HELD_OUT_GROUPS, TRUE_GROUPS

SAME_SURFACE = 0.02
"""Largest relative change of the true depth of a static pixel from the frame before."""
SAME_GRAY = 3
"""Largest change of the smoothed gray value of a static pixel, where the truth is unknown."""
GHOST_FRAMES = 5
"""Ghosts are counted this many frames after a moving object left a pixel, so once per departure."""
MEDIAN_PX = 5
"""Window of the median that keeps outliers of the sensor from casting shadows."""
VIRTUAL_WIDTH = 2
"""Width of the virtual camera's image in widths of the real one, because it looks further to the right."""


@dataclass(frozen=True, kw_only=True, eq=False)
class EvaluationFrame:
    """A frame with its reference. Methods see only `frame`; an oracle sees the pose too."""

    frame: Frame
    T_world_cam: FloatArray | None
    """True pose, shape (4, 4), for oracles; None if it is unknown."""
    reference_m: FloatImage
    """True or measured depth [m], shape (H, W), float32; +inf = none."""
    labels: GrayImage
    """Pixel group of each pixel, shape (H, W), uint8."""
    static: MaskImage
    """Pixels that show the same surface as in the frame before, shape (H, W)."""
    occluded_share: float | None
    """Share of the pixels with a reference that the second camera does not see, 0..1; None if it is unknown."""
    moving: MaskImage | None = None
    """Pixels of moving objects, shape (H, W); None if there are none or they are unknown."""
    departed_m: FloatImage | None = None
    """Depth of the moving object that left a pixel `GHOST_FRAMES` frames ago [m], shape (H, W); 0 elsewhere."""


class FrameCache:
    """Frames of one sequence in files: they are computed once for all methods, and only one is in memory.

    A megapixel takes 11 MB, or 16 MB where things move. The folder must exist.
    """

    def __init__(self, folder: Path) -> None:
        self._folder, self._frames = folder, 0

    def fill(self, frames: Iterable[EvaluationFrame], progress: Callable[[int], None] = lambda count: None) -> None:
        """Write frames and pass their number to `progress`; a frame that cannot be written is a `ScenarioError`."""
        for index, frame in enumerate(frames):
            what = f"cannot keep frame {index} in {self._folder}"
            with as_scenario_error(what):
                np.savez(self.path(index), **_arrays(frame))
            self._frames = index + 1
            progress(self._frames)

    def __len__(self) -> int:
        return self._frames

    def __getitem__(self, index: int) -> EvaluationFrame:
        """Read one frame; a failure is a `ScenarioError`."""
        what = f"cannot read frame {index} back from {self._folder}"
        with as_scenario_error(what), np.load(self.path(index), allow_pickle=False) as stored:
            return _evaluation_frame(dict(stored))

    def path(self, index: int) -> Path:
        """Return the file of a frame."""
        return self._folder / f"{index:06d}.npz"


def _arrays(frame: EvaluationFrame) -> dict[str, Any]:
    """The entries of a frame that are known, as arrays and numbers."""
    shown = {"stamp_s": frame.frame.stamp_s, "gray": frame.frame.gray, "depth_m": frame.frame.depth_m}
    return shown | {name: value for name, value in vars(frame).items() if name != "frame" and value is not None}


def _evaluation_frame(arrays: dict[str, Any]) -> EvaluationFrame:
    shown = Frame(stamp_s=float(arrays.pop("stamp_s")), gray=arrays.pop("gray"), depth_m=arrays.pop("depth_m"))
    share = arrays.pop("occluded_share", None)
    unknown: dict[str, Any] = {"T_world_cam": None}
    return EvaluationFrame(frame=shown, occluded_share=None if share is None else float(share), **(unknown | arrays))


Frames = FrameCache | list[EvaluationFrame]
"""Frames that can be read repeatedly."""


class SimulatedSource:
    """A recording with the truth, and the seed that it was rendered with, if that is known."""

    groups = TRUE_GROUPS

    def __init__(self, name: str, recording: Recording, seed: int | None) -> None:
        self.name, self.seed, self.intrinsics = name, seed, recording.intrinsics
        self._recording, self._moving_ids = recording, moving_ids(recording)

    def __len__(self) -> int:
        return len(self._recording)

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of all files of the first frames."""
        return self._recording.digest(frames)

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames; a file that is missing or damaged is a `RecordingError`.

        Holes are split by what was measured before, and moving objects are marked.
        """
        seen_before, departures = SeenBefore(self.intrinsics), Departures()
        before: Capture | None = None
        for index in range(frames):
            capture = self._recording[index]
            truth_m, occluded = capture.depth_true_m, capture.occluded
            known = np.isfinite(truth_m)
            hole = (capture.depth_raw_m == 0) & known
            seen, never = seen_before.split(hole, truth_m, capture.T_world_cam, capture.depth_raw_m)
            kind = occluded + np.uint8(2) * seen + np.uint8(4) * never
            before = capture if before is None else before
            with np.errstate(invalid="ignore"):
                close = np.abs(truth_m - before.depth_true_m) <= np.float32(SAME_SURFACE) * truth_m
            static: MaskImage = close & known & (capture.segment_id == before.segment_id) & (index > 0)
            moving: MaskImage | None = None
            departed_m: FloatImage | None = None
            if self._moving_ids:
                moving = np.isin(capture.segment_id, self._moving_ids)
                static, departed_m = static & ~moving, departures.add(moving, truth_m)
            yield EvaluationFrame(
                frame=frame_of(capture),
                T_world_cam=capture.T_world_cam,
                reference_m=truth_m,
                labels=TRUE_GROUPS.label(truth_m, kind.astype(np.uint8)),
                static=static,
                occluded_share=float((occluded & known).sum() / max(1, known.sum())),
                moving=moving,
                departed_m=departed_m,
            )
            before = capture


class HeldOutSource:
    """A recording without the truth. Some measured pixels are withheld from the methods, which are scored by them."""

    groups = HELD_OUT_GROUPS
    seed: int | None = None

    def __init__(self, name: str, dataset: Dataset) -> None:
        self.name, self.intrinsics, self._dataset = name, dataset.intrinsics, dataset

    def __len__(self) -> int:
        return len(self._dataset)

    def digest(self, frames: int) -> str:
        """Return a SHA-256 of the camera and of all images, which are read for it."""
        total = sha256(repr(self.intrinsics).encode())
        for frame in map(self._dataset.__getitem__, range(frames)):
            crc32 = zlib.crc32(frame.depth_m.tobytes(), zlib.crc32(frame.gray.tobytes()))
            total.update(f"{frame.stamp_s} {crc32}".encode())
        return total.hexdigest()

    def frames(self, frames: int) -> Iterator[EvaluationFrame]:
        """Read the first frames without the pixels that are held out; a missing or damaged one is a `DatasetError`."""
        gray_before: GrayImage | None = None
        for index in range(frames):
            frame = self._dataset[index]
            gray = cv2.blur(frame.gray, (5, 5)).astype(np.uint8)
            change = cv2.absdiff(gray, gray if gray_before is None else gray_before)
            held_out = shadows(frame.depth_m, self.intrinsics)
            reference_m = np.where(frame.depth_m > 0, frame.depth_m, np.float32(np.inf))
            given_m = np.where(held_out, np.float32(0), frame.depth_m)
            yield EvaluationFrame(
                frame=Frame(stamp_s=frame.stamp_s, gray=frame.gray, depth_m=given_m),
                T_world_cam=None,
                reference_m=reference_m,
                labels=HELD_OUT_GROUPS.label(reference_m, held_out.astype(np.uint8)),
                static=(change <= SAME_GRAY) & (index > 0),
                occluded_share=None,
            )
            gray_before = gray


FrameSource = SimulatedSource | HeldOutSource
"""A sequence that methods can be compared on."""


def open_source(folder: Path) -> FrameSource:
    """Open the sequence in a folder of any format; one without a readable sequence or a name is an error."""
    name = folder.resolve().name
    if not name:
        raise ScenarioError(f"--data must name the folder of a sequence, got {folder}")
    if (folder / "depth_true").is_dir():  # Only recordings with the truth have it.
        return SimulatedSource(name, Recording.open(folder), None)
    return HeldOutSource(name, open_dataset(folder))


class Departures:
    """Follows the frames of a sequence and finds the pixels that moving objects have left."""

    def __init__(self) -> None:
        self._past_m: deque[FloatImage] = deque(maxlen=GHOST_FRAMES)

    def add(self, moving: MaskImage, truth_m: FloatImage) -> FloatImage:
        """Add the pixels of moving objects and the true depth [m] of the next frame, shape (H, W).

        Returns:
            True depth of the moving object that was last at a pixel `GHOST_FRAMES` frames ago [m], shape (H, W),
            float32; 0 where none was, or where one has been since.
        """
        moving_m = np.where(moving, truth_m, np.float32(0)).astype(np.float32)
        departed_m = np.zeros_like(moving_m)
        if len(self._past_m) == GHOST_FRAMES:
            first_m, *later_m = self._past_m
            departed_m = np.where(np.any([*later_m, moving_m], axis=0), np.float32(0), first_m)
        self._past_m.append(moving_m)
        return departed_m


def shadows(depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Find the measured pixels that a virtual camera, one baseline to the left, would not see.

    A second camera to the right of the first hides what lies to the left of a near object. The shadows of a camera to
    the left have the same shape and move with the scene, but fall where there is depth. From that camera a pixel in
    column u with the disparity d appears in column u + d, and is hidden if one with more than a pixel more disparity
    appears in the same column. A longer baseline makes wider shadows, up to the width of the object.

    Args:
        depth_m: Measured depth [m], shape (H, W); 0 = invalid, which neither casts nor receives a shadow.
        intrinsics: Intrinsics of the camera that measured it.

    Returns:
        Shape (H, W); shadows narrower than three pixels are left out.
    """
    valid = depth_m > 0
    focal_baseline_px_m = np.float32(intrinsics.focal_baseline_px_m)
    disparity_px = np.divide(focal_baseline_px_m, depth_m, out=np.zeros_like(depth_m), where=valid)
    disparity_px = cv2.medianBlur(disparity_px, MEDIAN_PX).astype(np.float32)
    valid &= disparity_px > 0
    virtual_col = np.rint(np.arange(depth_m.shape[1], dtype=np.float32) + disparity_px)
    valid &= virtual_col < VIRTUAL_WIDTH * depth_m.shape[1]
    row, col = np.nonzero(valid)
    at, disparity_px = virtual_col[valid].astype(np.intp), disparity_px[valid]
    nearest_px = np.zeros((depth_m.shape[0], VIRTUAL_WIDTH * depth_m.shape[1]), np.float32)
    np.maximum.at(nearest_px, (row, at), disparity_px)
    # A stretched surface leaves gaps in the virtual image; those of a single column are closed.
    nearest_px = cv2.morphologyEx(nearest_px, cv2.MORPH_CLOSE, np.ones((1, 3), np.uint8)).astype(np.float32)
    hidden = np.zeros(depth_m.shape, np.uint8)
    hidden[row, col] = nearest_px[row, at] > disparity_px + 1
    return cv2.morphologyEx(hidden, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)).astype(np.bool_)
