"""The image work on the CPU: OpenCV and NumPy where they are faster, Warp for scattered writes."""

import cv2
import numpy as np

from ..types import FloatArray, FloatImage, GrayImage, Intrinsics
from .combine import combine
from .config import PaperConfig
from .projection import project_voxels
from .voxels import VoxelGrid


class HostSteps:
    """`ImageSteps` on NumPy arrays. Which library does a step was decided by `voxdepth bench`.

    A warped template, and what is combined into it, lasts until the next one is warped.
    """

    def __init__(self, intrinsics: Intrinsics, config: PaperConfig) -> None:
        self._intrinsics = intrinsics
        self._config = config
        self._grid = VoxelGrid(config.voxels)
        self._warped = np.empty(intrinsics.shape, np.float32)
        self._scratch = np.empty(intrinsics.shape, np.float32)

    def clear(self) -> None:
        """See `ImageSteps`."""
        self._grid.clear()

    def integrate(self, depth_m: FloatImage, T_grid_cam: FloatArray) -> None:
        """See `ImageSteps`."""
        self._grid.integrate_image(depth_m, self._intrinsics, T_grid_cam)

    def project(self) -> FloatImage:
        """See `ImageSteps`."""
        return project_voxels(self._grid, self._intrinsics)

    def inpaint(self, sparse: FloatImage) -> FloatImage:
        """See `ImageSteps`."""
        return self._config.inpainting.fill(sparse)

    def upload(self, depth_m: FloatImage) -> FloatImage:
        """See `ImageSteps`."""
        return depth_m

    def warp(self, template: FloatImage, M_frame_template: FloatArray) -> FloatImage:
        """See `ImageSteps`."""
        height, width = self._intrinsics.shape
        return cv2.warpAffine(  # type: ignore[return-value]
            template, M_frame_template, (width, height), dst=self._warped, flags=cv2.INTER_NEAREST
        )

    def combine(self, raw: FloatImage, template: FloatImage) -> tuple[FloatImage, GrayImage]:
        """See `ImageSteps`."""
        return template, combine(template, raw, self._config.combine, self._scratch)

    def unchanged(self, raw: FloatImage) -> tuple[FloatImage, GrayImage]:
        """See `ImageSteps`."""
        return raw, (raw > 0).view(np.uint8)

    def filter(self, depth: FloatImage) -> FloatImage:
        """See `ImageSteps`."""
        filtered: FloatImage = cv2.medianBlur(depth, self._config.median_size_px)  # type: ignore[assignment]
        return filtered

    def download(self, depth: FloatImage, source: GrayImage) -> tuple[FloatImage, GrayImage]:
        """See `ImageSteps`."""
        return depth, source
