"""Errors of real depth cameras at the rims of surfaces, and speckles, each of which belongs to a voxel of the scene.

The terms apply to the depth of any sensor model. A voxel is a cube in the world that contains the surface of a pixel.
Its random numbers do not depend on the frame, so that an error comes again wherever the camera sees the voxel.
"""

import math
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import numpy.typing as npt
from pydantic import AfterValidator, Field, NonNegativeFloat
from scipy.ndimage import gaussian_filter

from voxdepth.arithmetic import matmul
from voxdepth.model import Model
from voxdepth.types import FloatImage, MaskImage

from .depth_noise import NoiseTerm, NoisyDepth
from .seeds import Purpose, stream
from .types import InvalidReason, in_order

STEP = 0.9
"""A depth of less than this share of another one belongs to a nearer surface."""
PERSISTENCE = 0.85
"""Probability of a speckle in each frame."""
GLOSS_CELL_M = 0.04
"""Side of a cell that may be glossy."""
GLOSS_PATCH_PX = 4.0
"""Size of the patches that such cells form, as the sigma of a Gaussian."""
TABLE = 1 << 16
CELLS_PER_AXIS = 1 << 20
NEIGHBOURS = np.array([[0, 1], [1, 0], [0, -1], [-1, 0]])


Width = Annotated[int, Field(ge=0)]
Size = Annotated[int, Field(ge=1)]
Pixels = Annotated[tuple[Width, Width], Field(strict=False), AfterValidator(in_order)]
Ratios = Annotated[tuple[NonNegativeFloat, NonNegativeFloat], Field(strict=False), AfterValidator(in_order)]


def voxels_of(image: NoisyDepth, side_m: float) -> npt.NDArray[np.int64]:
    """Return the number of the cube with each pixel's surface, shape (H, W); without one, it is the camera's cube.

    The cubes have sides of `side_m` and are slightly off the origin, where surfaces of scenes often lie.
    """
    camera, T = image.intrinsics, image.T_world_cam
    row, col = np.indices(image.depth_m.shape)
    depth_m = np.where(np.isfinite(image.depth_true_m), image.depth_true_m, 0)
    x_m, y_m = ((col - camera.cx_px) / camera.fx_px * depth_m, (row - camera.cy_px) / camera.fy_px * depth_m)
    point_m = matmul(np.stack([x_m, y_m, depth_m], axis=-1), T[:3, :3].T) + T[:3, 3]
    x, y, z = np.moveaxis(np.floor(point_m / side_m + 0.37).astype(np.int64) % CELLS_PER_AXIS, -1, 0)
    return np.asarray((x * CELLS_PER_AXIS + y) * CELLS_PER_AXIS + z)


def uniform_of(voxel: npt.NDArray[np.int64], seed: int, *key: int) -> FloatImage:
    """Return a random number in 0..1 for each voxel; voxels far apart may share one."""
    table = stream(seed, Purpose.VOXEL, *key).random(TABLE, np.float32)
    # Fibonacci hashing: the upper 16 bits of the product with 2^64 over the golden ratio are the index into the table.
    mixed = (voxel.astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(48)
    return table[mixed.astype(np.intp)]


class Rims(NoiseTerm):
    """Near surfaces are drawn too wide on both sides, and occlusion shadows reach into the background.

    The widths differ from voxel to voxel, so that the rims are ragged, and are the same in every frame.
    """

    uses_shadows: ClassVar[bool] = True
    fatten_px: Pixels = (0, 0)
    """Least and largest width by which a near surface is drawn over the background."""
    erode_px: Pixels = (0, 0)
    """Least and largest width of the background beside an occlusion shadow that is invalid, too."""
    cell_m: float = Field(default=0.02, gt=0)
    """Side of a voxel [m]; smaller voxels make rougher rims."""

    def apply(self, image: NoisyDepth) -> None:
        """Widen the shadows, then draw near surfaces over them and over the background."""
        uniform = uniform_of(voxels_of(image, self.cell_m), image.seed)
        width_px = _between(self.erode_px, uniform)
        far_m, eroded = np.where(image.occluded, image.depth_true_m, np.inf), np.zeros_like(image.occluded)
        for shift in _shifts(self.erode_px[1]):
            same_surface = image.depth_true_m > STEP * _shifted(far_m, shift, np.inf)
            eroded |= same_surface & (abs(shift) <= width_px)
        image.invalidate(eroded & ~image.occluded, InvalidReason.OCCLUDED)
        measured_m, width_px = image.depth_m.copy(), _between(self.fatten_px, uniform)
        measured_m[measured_m == 0] = np.inf
        nearest_m = np.full_like(measured_m, np.inf)
        for shift in _shifts(self.fatten_px[1]):
            beside_m = np.where(abs(shift) <= width_px, _shifted(measured_m, shift, np.inf), np.inf)
            nearest_m = np.minimum(nearest_m, beside_m)
        drawn = nearest_m < STEP * image.depth_true_m
        drawn &= nearest_m < STEP * measured_m
        image.depth_m[drawn], image.invalid_reason[drawn] = nearest_m[drawn], InvalidReason.NONE


class Speckles(NoiseTerm):
    """Connected speckles of a depth of their own. Those of a voxel have the same shape and depth in every frame."""

    uses_shadows: ClassVar[bool] = True
    share: float = Field(default=0.0, ge=0, le=1)
    """Share of the voxels that have a speckle."""
    where: Literal["shadows", "holes"] = "holes"
    """Pixels whose voxels may have speckles: occlusion shadows inside the image, or invalid pixels outside of any."""
    size_px: Annotated[tuple[Size, Size], Field(strict=False), AfterValidator(in_order)] = (5, 40)
    """Least and largest number of pixels; the logarithm of the size is uniform. Shadows cut their speckles off."""
    ratio: Ratios = (0.25, 0.6)
    """Least and largest depth relative to the true depth of the voxel; it may exceed the range of the sensor."""
    true_share: float = Field(default=0.0, ge=0, le=1)
    """Share of the speckles that show the true depth instead."""
    cell_m: float = Field(default=0.1, gt=0)
    """Side of a voxel [m]; smaller voxels have more speckles."""

    @property
    def active(self) -> bool:
        """Whether any voxel has a speckle."""
        return self.share > 0

    def apply(self, image: NoisyDepth) -> None:
        """Draw the speckles of all voxels in view, in the order of the voxels."""
        area = inner(image.occluded) if self.where == "shadows" else ~image.occluded & (image.depth_m == 0)
        area &= np.isfinite(image.depth_true_m)
        voxel = voxels_of(image, self.cell_m)
        chosen = area & (uniform_of(voxel, image.seed, 1) < self.share)
        keys, inverse = np.unique(voxel[chosen], return_inverse=True)
        pixels = np.argwhere(chosen)
        members = np.split(pixels[np.argsort(inverse, kind="stable")], np.cumsum(np.bincount(inverse))[:-1])
        for key, member in zip(keys.tolist(), members, strict=False):
            if stream(image.seed, Purpose.SPECKLES, key, *image.key).random() < PERSISTENCE:
                self._draw(image, area, member, stream(image.seed, Purpose.SPECKLES, key))

    def _draw(self, image: NoisyDepth, area: MaskImage, member: npt.NDArray[np.intp], rng: np.random.Generator) -> None:
        """Draw the speckle of a voxel, around the pixel of the voxel that is nearest to the mean of its pixels."""
        center = member[np.square(member - member.mean(axis=0)).sum(axis=1).argmin()]
        low_px, high_px = math.log(self.size_px[0]), math.log(self.size_px[1] + 1)
        size, shows_truth = int(math.exp(rng.uniform(low_px, high_px))), rng.random() < self.true_share
        ratio = 1.0 if shows_truth else rng.uniform(*self.ratio)
        row, col = np.transpose(center + grown(rng, size))
        inside = (row >= 0) & (row < area.shape[0]) & (col >= 0) & (col < area.shape[1])
        row, col = row[inside], col[inside]
        if self.where == "shadows":
            row, col = row[area[row, col]], col[area[row, col]]
        image.depth_m[row, col] = np.float32(ratio) * image.depth_true_m[tuple(center)]
        image.invalid_reason[row, col] = InvalidReason.NONE


class NoReturn(NoiseTerm):
    """Dark surfaces, and the glossy part of others, return too little light of a projector."""

    below_albedo: float = Field(default=0.0, ge=0, le=1)
    """Surfaces that reflect a smaller share of the light have no depth."""
    gloss: float = Field(default=0.0, ge=0)
    """Factor of the share of each surface that is glossy: 0 ignores gloss, and 1 takes that share of its voxels."""

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate dark surfaces and glossy patches."""
        n_bodies = 1 + max([int(image.segment_id.max()), *image.surfaces])
        albedo, gloss = np.ones(n_bodies + 1), np.zeros(n_bodies + 1)  # The last entry is that of no body.
        for body, surface in image.surfaces.items():
            albedo[body], gloss[body] = surface.albedo, surface.gloss
        smooth = gaussian_filter(
            uniform_of(voxels_of(image, GLOSS_CELL_M), image.seed, 2), GLOSS_PATCH_PX, mode="mirror"
        )
        # The argsort of an argsort is the rank of each pixel, so that exactly the wanted share is missed.
        rank = np.argsort(np.argsort(smooth, axis=None)).reshape(smooth.shape) / smooth.size
        missed = (albedo[image.segment_id] < self.below_albedo) | (rank < self.gloss * gloss[image.segment_id])
        image.invalidate(missed, InvalidReason.TEXTURELESS)


class Artefacts(Model):
    """All terms; they apply in the order of the fields, and none is active by default."""

    no_return: NoReturn = NoReturn()
    rims: Rims = Rims()
    islands: Speckles = Speckles(where="shadows", size_px=(1, 40), ratio=(0.5, 1.3), true_share=0.5, cell_m=0.02)
    """Islands of wrong or background depth within occlusion shadows."""
    specks: Speckles = Speckles()
    """Speckles that a camera sees again and again at the same points of the scene."""

    @property
    def terms(self) -> tuple[NoiseTerm, ...]:
        """The active terms."""
        return tuple(term for term in (self.no_return, self.rims, self.islands, self.specks) if term.active)


def grown(rng: np.random.Generator, size: int) -> npt.NDArray[np.int64]:
    """Return offsets (row, col) of connected pixels around (0, 0), shape (size, 2), that grew by one at a time."""
    offsets = [(0, 0)]
    while len(offsets) < size:
        row, col = np.array(offsets[rng.integers(len(offsets))]) + NEIGHBOURS[rng.integers(len(NEIGHBOURS))]
        if (row, col) not in offsets:
            offsets.append((int(row), int(col)))
    return np.array(offsets)


def inner(mask: MaskImage) -> MaskImage:
    """Return the mask without the pixels that it connects to the left or right border of the image, row by row."""
    from_left, from_right = (np.minimum.accumulate(side, axis=1) for side in (mask, mask[:, ::-1]))
    return np.asarray(mask & ~from_left & ~from_right[:, ::-1])


def _between(bounds_px: tuple[int, int], uniform: FloatImage) -> npt.NDArray[np.int64]:
    """Return a whole number of pixels within bounds, from a random number for each pixel."""
    low, high = bounds_px
    return (low + np.floor(uniform * (high + 1 - low))).astype(np.int64)


def _shifts(widest_px: int) -> list[int]:
    return [shift for shift in range(-widest_px, widest_px + 1) if shift]


def _shifted(values: npt.NDArray[Any], by_px: int, fill: float) -> npt.NDArray[Any]:
    """Return the values `by_px` columns to the right of each pixel; `fill` beyond the image."""
    padded = np.pad(values, ((0, 0), (abs(by_px), abs(by_px))), constant_values=fill)
    start = abs(by_px) + by_px
    return padded[:, start : start + values.shape[1]]
