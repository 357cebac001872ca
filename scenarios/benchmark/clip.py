"""A few frames that are played for as long as a measurement lasts."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain, cycle, islice

import cv2

from voxdepth.types import FloatImage, Frame, GrayImage, Intrinsics

RATE_HZ = 30.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """Images of one camera in the order in which they were taken."""

    intrinsics: Intrinsics
    grays: tuple[GrayImage, ...]
    """Each of shape (H, W), uint8."""
    depths_m: tuple[FloatImage, ...]
    """Depth along the optical axis [m], each of shape (H, W), float32; 0 = invalid."""

    @property
    def size(self) -> str:
        """Width and height, as in 640x360."""
        return f"{self.intrinsics.width_px}x{self.intrinsics.height_px}"

    @property
    def n_bytes(self) -> int:
        """Memory of the images."""
        return sum(gray.nbytes + depth_m.nbytes for gray, depth_m in zip(self.grays, self.depths_m, strict=True))

    def first(self, frames: int) -> "Clip":
        """A shorter clip."""
        return replace(self, grays=self.grays[:frames], depths_m=self.depths_m[:frames])

    def resized(self, width_px: int, height_px: int) -> "Clip":
        """The same of another size; gray is interpolated, depth is not."""
        size = (width_px, height_px)
        grays = [cv2.resize(gray, size, interpolation=cv2.INTER_LINEAR) for gray in self.grays]
        depths_m = [cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST) for depth_m in self.depths_m]
        return Clip(
            intrinsics=resized(self.intrinsics, width_px, height_px),
            grays=tuple(grays),  # type: ignore[arg-type]
            depths_m=tuple(depths_m),  # type: ignore[arg-type]
        )

    def play(self, frames: int) -> Iterator[Frame]:
        """That many frames at 30 Hz, in continuous motion; they share the images of the clip."""
        for k, index in enumerate(self.indices(frames)):
            yield Frame(stamp_s=k / RATE_HZ, gray=self.grays[index], depth_m=self.depths_m[index])

    def indices(self, frames: int) -> Iterator[int]:
        """Numbers of the images that are played, forwards and backwards in turn."""
        n = len(self.grays)
        return islice(cycle(chain(range(n), range(n - 2, 0, -1))), frames)


def resized(intrinsics: Intrinsics, width_px: int, height_px: int) -> Intrinsics:
    """The camera whose images `cv2.resize` makes of those of another: centres at half-integers scale."""
    scale_x, scale_y = width_px / intrinsics.width_px, height_px / intrinsics.height_px
    return replace(
        intrinsics,
        fx_px=scale_x * intrinsics.fx_px,
        fy_px=scale_y * intrinsics.fy_px,
        cx_px=scale_x * (intrinsics.cx_px + 0.5) - 0.5,
        cy_px=scale_y * (intrinsics.cy_px + 0.5) - 0.5,
        width_px=width_px,
        height_px=height_px,
    )
