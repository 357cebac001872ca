"""Noise terms of the sensor model `noisy`. Each can be enabled alone and has the statistics of its configuration.

Every draw is keyed by seed, purpose, drone and frame, and within a frame by pixel or by body id, so that it does not
depend on what else is in the image.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
from pydantic import Field, model_validator

from voxdepth.model import Model
from voxdepth.types import FloatArray, FloatImage, GrayImage, Intrinsics, MaskImage

from .bodies import Surface
from .seeds import Purpose, stream
from .stereo import image_focal_baseline_px_m
from .types import IdImage, InvalidReason

SensorModelName = Literal["truth", "noisy", "fitted", "stereo"]
SENSOR_MODEL_NAMES: tuple[SensorModelName, ...] = get_args(SensorModelName)


@dataclass(frozen=True, kw_only=True, eq=False)
class NoisyDepth:
    """A depth image while noise is added to it. The terms change `depth_m` and `invalid_reason` in place."""

    depth_m: FloatImage
    """Shape (H, W), float32; 0 = invalid, +inf where there is no surface."""
    invalid_reason: GrayImage
    """One `InvalidReason` per pixel."""
    segment_id: IdImage
    occluded: MaskImage
    depth_true_m: FloatImage
    """Shape (H, W); +inf where there is no surface."""
    T_world_cam: FloatArray
    """Pose of the camera, shape (4, 4)."""
    surfaces: Mapping[int, Surface]
    """Surface of each body."""
    intrinsics: Intrinsics
    seed: int
    key: tuple[int, int]
    """Drone and frame."""

    def rng(self, purpose: Purpose) -> np.random.Generator:
        """Return the random stream of one purpose for this drone and frame."""
        return stream(self.seed, purpose, *self.key)

    def invalidate(self, pixels: MaskImage, reason: InvalidReason) -> None:
        """Invalidate pixels; those that are invalid already keep their first reason."""
        self.invalid_reason[pixels & (self.depth_m > 0)] = reason
        self.depth_m[pixels] = 0


class NoiseTerm(Model, ABC):
    """One kind of depth error."""

    uses_shadows: ClassVar[bool] = False
    """Whether the term depends on what the second camera does not see."""

    @property
    def active(self) -> bool:
        """Whether the configuration differs from the default, with which a term changes nothing."""
        return self != type(self)()

    @abstractmethod
    def apply(self, image: NoisyDepth) -> None:
        """Change the image in place."""


class Scale(NoiseTerm):
    """`D + D beta` with `beta ~ U[-theta, theta]`, drawn for every frame: paper, Eq. noisesim."""

    theta: float = Field(default=0.0, ge=0, le=1)
    """Noise ratio threshold; 0 disables the term, and more than 1 would make depths negative."""
    unit: Literal["object", "frame", "pixel"] = "object"
    """The unit that shares one draw."""

    def apply(self, image: NoisyDepth) -> None:
        """Scale valid depths."""
        rng = image.rng(Purpose.SCALE)
        if self.unit == "object":  # Body k takes draw k + 1 of the stream, whichever bodies are in the image.
            n_draws = int(image.segment_id.max(initial=-1)) + 2
            scale = (1 + rng.uniform(-self.theta, self.theta, n_draws)).take(image.segment_id + 1)
        else:
            scale = 1 + rng.uniform(-self.theta, self.theta, image.depth_m.shape if self.unit == "pixel" else 1)
        np.multiply(image.depth_m, scale, out=image.depth_m, casting="same_kind")


class Disparity(NoiseTerm):
    """Gaussian noise of the disparity, which is then rounded to whole steps."""

    sigma_px: float = Field(default=0.0, ge=0)
    """Standard deviation of the disparity. The depth error grows with the square of the depth."""
    step_px: float = Field(default=0.0, ge=0)
    """Quantisation step of the disparity; 0 disables rounding. A RealSense D400 has 1/32 px."""

    def apply(self, image: NoisyDepth) -> None:
        """Disturb valid depths; disparities at or below 0 give infinite depth."""
        focal_baseline = image_focal_baseline_px_m(image.intrinsics)
        noise_px = self.sigma_px * image.rng(Purpose.DISPARITY).standard_normal(image.depth_m.shape)
        valid = image.depth_m > 0
        disparity_px = focal_baseline / np.where(valid, image.depth_m, 1.0) + noise_px
        if self.step_px:
            disparity_px = self.step_px * np.rint(disparity_px / self.step_px)
        with np.errstate(divide="ignore"):
            depth_m = focal_baseline / np.maximum(disparity_px, 0)
        image.depth_m[valid] = depth_m[valid]


class PatchFlicker(NoiseTerm):
    """Square patches of pixels that drop out or change their depth for one frame."""

    dropout: float = Field(default=0.0, ge=0, le=1)
    """Share of patches without depth."""
    jump: float = Field(default=0.0, ge=0, le=1)
    """Share of patches with a wrong depth."""
    jump_ratio: float = Field(default=0.3, ge=0, lt=1)
    """Error of a patch with a wrong depth, nearer or farther, relative to its depth."""
    patch_px: int = Field(default=4, ge=1, le=4_096)
    """Side of a patch."""

    @model_validator(mode="after")
    def _check(self) -> "PatchFlicker":
        if self.dropout + self.jump > 1:
            raise ValueError(f"dropout and jump are shares of all patches, got {self.dropout} + {self.jump} > 1")
        return self

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate some patches and scale others."""
        height, width = image.depth_m.shape
        p, rng = self.patch_px, image.rng(Purpose.FLICKER)
        event, sign = rng.random((2, -(-height // p), -(-width // p)))
        event, sign = (patches.repeat(p, axis=0).repeat(p, axis=1)[:height, :width] for patches in (event, sign))
        jumps = event > 1 - self.jump
        image.depth_m[jumps] *= np.where(sign < 0.5, 1 - self.jump_ratio, 1 + self.jump_ratio)[jumps]
        image.invalidate(event < self.dropout, InvalidReason.FLICKER)


class Textureless(NoiseTerm):
    """Surfaces with too little texture have no depth."""

    below_texture: float = Field(default=0.0, ge=0)
    """Surfaces with a weaker texture than this are invalid; 0 disables the term."""

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate surfaces with too little texture."""
        bodies = [body for body, surface in image.surfaces.items() if surface.texture < self.below_texture]
        image.invalidate(np.isin(image.segment_id, bodies), InvalidReason.TEXTURELESS)


class Occlusion(NoiseTerm):
    """Surfaces that the second camera does not see have no depth."""

    uses_shadows: ClassVar[bool] = True
    enabled: bool = True

    @property
    def active(self) -> bool:
        """Whether the term is enabled, as it is by default."""
        return self.enabled

    def apply(self, image: NoisyDepth) -> None:
        """Invalidate occluded pixels."""
        image.invalidate(image.occluded, InvalidReason.OCCLUDED)


class DepthNoise(Model):
    """All terms; they apply in the order of the fields. By default only occlusion is enabled."""

    occlusion: Occlusion = Occlusion()
    scale: Scale = Scale()
    disparity: Disparity = Disparity()
    flicker: PatchFlicker = PatchFlicker()
    blank: Textureless = Textureless()

    @property
    def terms(self) -> tuple[NoiseTerm, ...]:
        """The active terms."""
        return tuple(term for _, term in self if term.active)
