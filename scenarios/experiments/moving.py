"""Moving a reference image to where its points are in a later one: by the registered affine map, or by optical flow."""

from typing import Any, Protocol

import cv2
import numpy as np

from voxdepth.baselines.optical_flow import Flow, FlowImage
from voxdepth.metrics import psnr_db
from voxdepth.paper.registration import Features, OrbRegistration, RegistrationConfig
from voxdepth.types import FloatArray, GrayImage, MaskImage

PEAK_GRAY = 255.0


class Moved(Protocol):
    """Where everything went."""

    ok: bool
    """Whether a motion was found; if not, nothing moves."""

    def apply(self, image: Any) -> Any:
        """A reference image, shape (H, W), as the later one shows it: nearest pixels, 0 for what it does not have."""
        ...


class Mover(Protocol):
    """A way to find the motion between two gray images of one size."""

    def keep(self, reference: GrayImage) -> None:
        """Take the reference image, shape (H, W), and do what has to be done once."""
        ...

    def find(self, current: GrayImage) -> Moved:
        """The motion from the reference to a later image, shape (H, W)."""
        ...


class Affine:
    """An affine map."""

    def __init__(self, M_current_reference: FloatArray, *, ok: bool) -> None:
        self._M, self.ok = M_current_reference, ok

    def apply(self, image: Any) -> Any:
        """See `Moved`."""
        height, width = image.shape
        return cv2.warpAffine(image, self._M, (width, height), flags=cv2.INTER_NEAREST)


class Flown:
    """A flow from each pixel of the later image to the reference."""

    ok = True

    def __init__(self, to_reference_px: FlowImage) -> None:
        self._to_reference_px = to_reference_px

    def apply(self, image: Any) -> Any:
        """See `Moved`."""
        height, width = image.shape
        col = np.arange(width, dtype=np.float32) + self._to_reference_px[..., 0]
        row = np.arange(height, dtype=np.float32)[:, None] + self._to_reference_px[..., 1]
        return cv2.remap(image, col, row, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)


class Unmoved:
    """Takes the reference as it is: what every other way must beat."""

    def keep(self, reference: GrayImage) -> None:
        """See `Mover`."""

    def find(self, current: GrayImage) -> Affine:
        """See `Mover`."""
        return Affine(np.eye(2, 3), ok=True)


class ByRegistration:
    """The corrector's own: features that match, and an affine map; nothing moves where that fails."""

    def __init__(self, config: RegistrationConfig, shape: tuple[int, int]) -> None:
        self._registration = OrbRegistration(config, shape)
        self._features: Features | None = None

    def keep(self, reference: GrayImage) -> None:
        """See `Mover`."""
        self._features = self._registration.describe(reference)

    def find(self, current: GrayImage) -> Affine:
        """See `Mover`."""
        assert self._features is not None, "keep a reference first"
        found = self._registration.register(self._features, self._registration.describe(current))
        return Affine(found.M_frame_template, ok=found.ok)


class ByFlow:
    """Dense optical flow."""

    def __init__(self, flow: Flow) -> None:
        self._flow = flow
        self._reference: GrayImage | None = None

    def keep(self, reference: GrayImage) -> None:
        """See `Mover`."""
        self._reference = reference

    def find(self, current: GrayImage) -> Flown:
        """See `Mover`."""
        assert self._reference is not None, "keep a reference first"
        return Flown(self._flow.between(current, self._reference))


def covered(moved: Moved, shape: tuple[int, int]) -> MaskImage:
    """Pixels of the later image that the moved reference reaches, shape (H, W)."""
    reached: MaskImage = moved.apply(np.ones(shape, np.uint8)) > 0
    return reached


class GrayError:
    """Squared differences of gray images, added up over pairs."""

    def __init__(self) -> None:
        self._squared, self.pixels = 0.0, 0

    def add(self, moved: GrayImage, current: GrayImage, where: MaskImage) -> None:
        """Take in a pair; all of shape (H, W)."""
        difference = moved[where].astype(np.float64) - current[where]
        self._squared += float(np.square(difference).sum())
        self.pixels += difference.size

    @property
    def psnr_db(self) -> float | None:
        """Quality of registration: the paper's PSNR of two gray images, peak 255 [dB]; None without a pixel."""
        if not self.pixels:
            return None
        return psnr_db(self._squared / self.pixels, PEAK_GRAY)
