"""The noise terms of the sensor model `noisy`. Each is switchable alone and has the statistics of its configuration.

Every draw is keyed by seed, purpose, drone and frame, and within a frame by pixel or by object id: what else is seen
never shifts it.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from voxdepth.types import FloatImage, GrayImage, Intrinsics, MaskImage

from .model import Model
from .noise import stereo_focal_baseline_px_m
from .seeds import Purpose, stream
from .types import IdImage, InvalidReason

ScaleUnit = Literal["object", "frame", "pixel"]


@dataclass(frozen=True, kw_only=True, eq=False)
class NoisyDepth:
    """A depth image while noise is added to it; terms change the two images in place."""

    depth_m: FloatImage
    """Shape (H, W), float32; 0 = invalid, +inf where there is no surface."""
    invalid_reason: GrayImage
    """One `InvalidReason` per pixel."""
    segment_id: IdImage
    occluded: MaskImage
    texture_of_body: Mapping[int, float]
    """Strength of the texture of each body."""
    intrinsics: Intrinsics
    seed: int
    key: tuple[int, int]
    """Drone and frame."""

    def draws(self, purpose: Purpose) -> np.random.Generator:
        """The stream of one purpose for this drone and frame."""
        return stream(self.seed, purpose, *self.key)

    def lose(self, lost: MaskImage, reason: InvalidReason) -> None:
        """Invalidate pixels; those without a depth keep their first reason."""
        self.invalid_reason[lost & (self.depth_m > 0)] = reason
        self.depth_m[lost] = 0


class NoiseTerm(Model, ABC):
    """One way in which depth goes wrong."""

    @property
    @abstractmethod
    def active(self) -> bool:
        """Whether the term changes anything."""

    @abstractmethod
    def apply(self, image: NoisyDepth) -> None:
        """Change the image in place."""


class Scale(NoiseTerm):
    """`D + D beta` with `beta ~ U[-theta, theta]`, redrawn every frame: paper, Eq. noisesim."""

    theta: float = Field(0.0, ge=0, le=1)
    """Noise ratio threshold; 0 changes nothing, more than 1 would make depths negative."""
    unit: ScaleUnit = "object"
    """What shares one draw."""

    @property
    def active(self) -> bool:
        """Whether any of its magnitudes is above 0."""
        return self.theta > 0

    def apply(self, image: NoisyDepth) -> None:
        """Scale valid depths."""
        rng, shape = image.draws(Purpose.SCALE), image.depth_m.shape
        if self.unit == "pixel":
            beta = rng.uniform(-self.theta, self.theta, shape)
        elif self.unit == "frame":
            beta = np.full(shape, rng.uniform(-self.theta, self.theta))
        else:  # The draw of body k is the k-th of the stream.
            n_bodies = int(image.segment_id.max(initial=-1)) + 2
            beta = rng.uniform(-self.theta, self.theta, n_bodies)[image.segment_id + 1]
        image.depth_m[:] = image.depth_m * (1 + beta)


class Disparity(NoiseTerm):
    """Gaussian noise of the disparity, then rounding to whole steps, as a matcher has it."""

    sigma_px: float = Field(0.0, ge=0)
    """Deviation; the depth error grows with the square of the depth."""
    step_px: float = Field(0.0, ge=0)
    """Quantum of the disparity; 0 rounds nothing. A RealSense D400 has 1/32 px."""

    @property
    def active(self) -> bool:
        """Whether any of its magnitudes is above 0."""
        return self.sigma_px > 0 or self.step_px > 0

    def apply(self, image: NoisyDepth) -> None:
        """Disturb valid depths; disparities at or below 0 are infinitely far."""
        focal_baseline = stereo_focal_baseline_px_m(image.intrinsics)
        noise_px = self.sigma_px * image.draws(Purpose.DISPARITY).standard_normal(image.depth_m.shape)
        valid = image.depth_m > 0
        disparity_px = focal_baseline / np.where(valid, image.depth_m, 1.0) + noise_px
        if self.step_px:
            disparity_px = self.step_px * np.rint(disparity_px / self.step_px)
        with np.errstate(divide="ignore"):
            depth_m = focal_baseline / np.maximum(disparity_px, 0)
        image.depth_m[valid] = depth_m[valid]


class Flicker(NoiseTerm):
    """Patches of pixels that drop out or jump for one frame."""

    dropout: float = Field(0.0, ge=0, le=1)
    """Share of patches without depth."""
    jump: float = Field(0.0, ge=0, le=1)
    """Share of patches at another depth."""
    jump_ratio: float = Field(0.3, ge=0, lt=1)
    """A jumping patch is farther or nearer by this part of its depth."""
    patch_px: int = Field(4, ge=1)
    """Side of a patch."""

    @model_validator(mode="after")
    def _check(self) -> "Flicker":
        if self.dropout + self.jump > 1:
            raise ValueError(f"dropout and jump are shares of all patches, got {self.dropout} + {self.jump} > 1")
        return self

    @property
    def active(self) -> bool:
        """Whether any of its magnitudes is above 0."""
        return self.dropout > 0 or self.jump > 0

    def apply(self, image: NoisyDepth) -> None:
        """Drop and move patches."""
        height, width = image.depth_m.shape
        p, rng = self.patch_px, image.draws(Purpose.FLICKER)
        fate, sign = rng.random((2, -(-height // p), -(-width // p)))
        fate, sign = (patches.repeat(p, axis=0).repeat(p, axis=1)[:height, :width] for patches in (fate, sign))
        jumps = fate > 1 - self.jump
        image.depth_m[jumps] *= np.where(sign < 0.5, 1 - self.jump_ratio, 1 + self.jump_ratio)[jumps]
        image.lose(fate < self.dropout, InvalidReason.FLICKER)


class Blank(NoiseTerm):
    """Surfaces without enough texture lose their depth."""

    below_texture: float = Field(0.0, ge=0)
    """Surfaces with a weaker texture than this are blank; 0 keeps all."""

    @property
    def active(self) -> bool:
        """Whether any of its magnitudes is above 0."""
        return self.below_texture > 0

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate blank surfaces."""
        blank = [body for body, texture in image.texture_of_body.items() if texture < self.below_texture]
        image.lose(np.isin(image.segment_id, blank), InvalidReason.TEXTURELESS)


class Occlusion(NoiseTerm):
    """Surfaces that the second camera does not see have no depth."""

    enabled: bool = True

    @property
    def active(self) -> bool:
        """Whether it is switched on."""
        return self.enabled

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate what is hidden."""
        image.lose(image.occluded, InvalidReason.OCCLUDED)


class DepthNoise(Model):
    """All terms, in the order in which they apply; a hole keeps its first reason. By default only occlusion is on."""

    occlusion: Occlusion = Occlusion()
    scale: Scale = Scale()
    disparity: Disparity = Disparity()
    flicker: Flicker = Flicker()
    blank: Blank = Blank()

    @property
    def terms(self) -> tuple[NoiseTerm, ...]:
        """The terms that do something."""
        every = (self.occlusion, self.scale, self.disparity, self.flicker, self.blank)
        return tuple(term for term in every if term.active)
