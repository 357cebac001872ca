"""References of real recordings: measured pixels that are held out, or a true depth of the sensor's holes.

Each kind of pixels is evaluated by itself: a method never gets an image with two kinds held out at once.
"""

from abc import ABC, abstractmethod
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple, Protocol

import cv2
import numpy as np

from ...datasets import Dataset, midair
from ...datasets.files import read_bytes
from ...datasets.images import read_depth_16
from ...types import ASSUMED_BASELINE_M, FloatImage, Intrinsics, MaskImage
from ...units import MILLIMETRES, Unit
from .frames import TRUTH, Reference

TRUE_DEPTH, TRUE_DEPTHS = "depth_true_mm.png", "depth_true"
"""The true depth of the first frame, and the folder of that of all frames."""
MEDIAN_PX = 5
"""Window of the median that keeps outliers of the sensor from casting shadows and from breaking surfaces."""
VIRTUAL_WIDTH = 2
"""Width of the virtual camera's image in widths of the real one, because it looks further to the right."""
PATCHES, TRIALS = 24, 1000
"""Largest number of patches, and number of positions that are tried for them."""
PATCH_PX, PATCH_IMAGE_PX = (10, 60), 640
"""Range of the diameters of patches in an image of that width; they grow with the width."""
STEP_PX, STEP_SHARE = 1.0, 0.05
"""A smooth surface changes by at most this many pixels of disparity and this share of it within the median's window."""
MEASURED_SHARE = 0.9
"""Share of a patch that must be measured."""
SEED = 0


class ReferenceImages(NamedTuple):
    """What methods are given of a frame and what they are scored by; shape (H, W) each."""

    given_m: FloatImage
    """Depth that methods are given [m]; 0 = invalid."""
    reference_m: FloatImage
    """Measured or true depth [m]; 0 where it is unknown or does not count."""
    hidden: MaskImage
    """Pixels of the kind that is evaluated."""


class References(ABC):
    """The references of one kind of pixels in one recording, whose frames are requested in order of time."""

    reference: Reference
    later_frames = 0
    """Number of frames after a frame that its reference is made of."""
    digest = ""
    """SHA-256 of the files that references are read from, besides those of the frames."""

    @abstractmethod
    def of(self, index: int, depth_m: FloatImage) -> ReferenceImages:
        """Return the reference of a frame by its index and its measured depth [m], shape (H, W); 0 = invalid."""


def held_out(name: str, *, is_mirrored: bool = False) -> Reference:
    """Return the reference of measured pixels that are held out, such as `patches`."""
    return Reference(name=f"held-out {name}", hidden=name, is_true=False, is_mirrored=is_mirrored)


class Shadows(References):
    """Occlusion shadows on the right side of near objects, see `shadows`; they move with the scene.

    Mirrored, they lie on the left side, where a stereo camera has its own.
    """

    reference = held_out("shadows", is_mirrored=True)
    widening = 1.0
    """Baseline of the camera that casts them, in baselines of the recording."""

    def __init__(self, dataset: Dataset) -> None:
        intrinsics = dataset.intrinsics
        self._intrinsics = replace(intrinsics, baseline_m=self.widening * (intrinsics.baseline_m or ASSUMED_BASELINE_M))

    def of(self, index: int, depth_m: FloatImage) -> ReferenceImages:
        """See `References`."""
        hidden = shadows(depth_m, self._intrinsics)
        return _held_out(depth_m, hidden, hidden)


class WideShadows(Shadows):
    """Shadows of a camera whose depth is aligned to a colour camera beside the pair."""

    reference = held_out("wide-shadows", is_mirrored=True)
    widening = 1.4


class Patches(References):
    """Ellipses on smooth surfaces, such as a stereo matcher loses where a wall is blank.

    The patches are drawn once, on the first frame, and stay the same in the image: depth is withheld there in every
    frame, so that the memory of a camera at rest never sees it. A patch is scored in the frames in which it lies on one
    measured surface.
    """

    reference = held_out("patches")

    def __init__(self, dataset: Dataset) -> None:
        self._intrinsics = dataset.intrinsics
        self._patches: list[MaskImage] = []

    def of(self, index: int, depth_m: FloatImage) -> ReferenceImages:
        """See `References`."""
        measured: MaskImage = depth_m > 0
        step = steps(depth_m, self._intrinsics)
        if index == 0:
            self._patches = self._drawn(measured, step)
        withheld, scored = np.zeros_like(measured), np.zeros_like(measured)
        for patch in self._patches:
            withheld |= patch
            if _is_smooth(patch, measured, step):
                scored |= patch & measured
        return _held_out(depth_m, withheld, scored)

    def _drawn(self, measured: MaskImage, step: MaskImage) -> list[MaskImage]:
        """Draw patches that lie on one surface and do not touch each other."""
        rng = np.random.default_rng(SEED)
        patches: list[MaskImage] = []
        taken = np.zeros(measured.shape, np.bool_)
        smallest_px, largest_px = np.array(PATCH_PX) * measured.shape[1] / PATCH_IMAGE_PX
        margin = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * round(smallest_px) + 1,) * 2)
        for _ in range(TRIALS):
            center = rng.integers(0, measured.shape[::-1]).tolist()
            diameter_px, flatness, angle_deg = rng.uniform((smallest_px, 0.6, 0), (largest_px, 1, 180)).tolist()
            axes = round(diameter_px / 2), round(flatness * diameter_px / 2)
            image = cv2.ellipse(np.zeros(measured.shape, np.uint8), center, axes, angle_deg, 0, 360, 1, -1)
            patch: MaskImage = image.astype(np.bool_)
            if len(patches) < PATCHES and _is_smooth(patch, measured, step) and not (patch & taken).any():
                patches.append(patch)
                taken |= cv2.dilate(image, margin).astype(np.bool_)
        return patches


class TrueHoles(References):
    """The sensor's own holes in a recording with a true depth, see `TrueDepths`."""

    reference = TRUTH

    def __init__(self, folder: Path, dataset: Dataset) -> None:
        self._truths, self._dataset = true_depths(folder), dataset
        digests = (sha256(read_bytes(path)).digest() for path in self._truths.files)
        self.digest = sha256(b"".join(digests)).hexdigest()

    def of(self, index: int, depth_m: FloatImage) -> ReferenceImages:
        """See `References`."""
        truth_m = self._truths.of(index, self._dataset)
        return ReferenceImages(
            depth_m, np.zeros_like(depth_m) if truth_m is None else truth_m, np.asarray(depth_m == 0)
        )


class TrueDepths(Protocol):
    """Images of true depth in the folder of a recording."""

    files: list[Path]

    def of(self, index: int, dataset: Dataset) -> FloatImage | None:
        """Read that of a frame [m], shape (H, W), 0 = unknown; None if there is none."""


class Millimetres:
    """PNG with 16 bits in millimetres, 0 = unknown.

    It is `depth_true_mm.png` for the first frame, or one image in `depth_true/` for each frame, with its name.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        found = [folder / TRUE_DEPTH, *sorted((folder / TRUE_DEPTHS).glob("*.png"))]
        self.files = [path for path in found if path.is_file()]

    def of(self, index: int, dataset: Dataset) -> FloatImage | None:
        """See `TrueDepths`."""
        own = self._folder / TRUE_DEPTHS / f"{dataset.name(index)}.png"
        path = self._folder / TRUE_DEPTH if index == 0 and not own.exists() else own
        return Unit(MILLIMETRES).metres(read_depth_16(path, dataset.intrinsics.shape)) if path.exists() else None


class Ranges:
    """Those of Mid-Air, see `voxdepth.datasets.midair`."""

    def __init__(self, folder: Path) -> None:
        self.files = midair.true_depths(folder)

    def of(self, index: int, dataset: Dataset) -> FloatImage | None:
        """See `TrueDepths`."""
        path = next((path for path in self.files if path.stem == dataset.name(index)), None)
        return None if path is None else midair.read_range(path, dataset.intrinsics)


def true_depths(folder: Path) -> TrueDepths:
    """Return the images of true depth in the folder of a recording, which has perhaps none."""
    ranges = Ranges(folder)
    return ranges if ranges.files else Millimetres(folder)


def mirrored(intrinsics: Intrinsics) -> Intrinsics:
    """Return the camera that takes the mirrored images."""
    return replace(intrinsics, cx_px=intrinsics.width_px - 1 - intrinsics.cx_px)


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
    disparity_px = _median_px(depth_m, intrinsics)
    valid = (depth_m > 0) & (disparity_px > 0)
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


def steps(depth_m: FloatImage, intrinsics: Intrinsics) -> MaskImage:
    """Find the pixels beside a depth discontinuity, shape (H, W), by measured depth [m]; 0 = invalid, which is none.

    The median of the disparity spans more than `STEP_PX` plus `STEP_SHARE` of its largest value within the window.
    """
    disparity_px = _median_px(depth_m, intrinsics)
    window = np.ones((MEDIAN_PX, MEDIAN_PX), np.uint8)
    largest_px = cv2.dilate(disparity_px, window)
    smallest_px = cv2.erode(np.where(disparity_px > 0, disparity_px, np.float32(np.inf)), window)
    return np.asarray(largest_px - smallest_px > STEP_PX + STEP_SHARE * largest_px)


def _held_out(depth_m: FloatImage, withheld: MaskImage, scored: MaskImage) -> ReferenceImages:
    """Withhold the measured depth [m] of pixels, and score methods by some of them."""
    counted = (depth_m > 0) & (scored | ~withheld)
    return ReferenceImages(
        given_m=np.where(withheld, np.float32(0), depth_m),
        reference_m=np.where(counted, depth_m, np.float32(0)),
        hidden=scored,
    )


def _is_smooth(patch: MaskImage, measured: MaskImage, step: MaskImage) -> bool:
    """Return whether enough of a patch is measured, and none of it is beside a depth discontinuity."""
    return not step[patch].any() and bool(measured[patch].mean() >= MEASURED_SHARE)


def _median_px(depth_m: FloatImage, intrinsics: Intrinsics) -> FloatImage:
    """Return the median of the disparity [px], shape (H, W); 0 = invalid."""
    focal_baseline_px_m = np.float32(intrinsics.focal_baseline_px_m)
    disparity_px = np.divide(focal_baseline_px_m, depth_m, out=np.zeros_like(depth_m), where=depth_m > 0)
    return cv2.medianBlur(disparity_px, MEDIAN_PX).astype(np.float32)
