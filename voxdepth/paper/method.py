"""The method of the paper: templates that are fused in one state and correct frames in the other."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numba import float32, uint8, void

from ..compiled import BYTE_IMAGE, FLOAT_IMAGE, READABLE_IMAGE, compile_all, compiled
from ..corrector import StreamCorrector, checked_config
from ..devices import DeviceName, require_device
from ..features import Features
from ..geometry import compose
from ..timing import StepTimer
from ..types import CorrectedDepth, FloatArray, FloatImage, Frame, GrayImage, Intrinsics, Source
from .config import VoxDepthConfig
from .epochs import Epochs, Template, VoxDepthDiagnostics
from .odometry import PhotometricOdometry, motion_between
from .registration import ChainedRegistration, OrbRegistration, Registration, RegistrationStatus, warped
from .voxels import VoxelConfig, VoxelGrid

if TYPE_CHECKING:
    from .warp_voxels import WarpVoxelGrid

Inpaint = Callable[[FloatImage], FloatImage]
"""Makes a sparse depth dense [m], shape (H, W), in a new image; 0 = unknown."""
SENSOR_CONFIDENCE, OTHER_CONFIDENCE = np.float32(1), np.float32(0.5)
"""Confidence of measured and of other pixels, by convention: the paper has none.

That of `create_corrector` is a probability, see `voxdepth.calibration`.
"""


@dataclass(frozen=True, kw_only=True, eq=False)
class Aligned:
    """A frame with everything that its correction needs: the result of the first half of the work."""

    frame: Frame
    diagnostics: VoxDepthDiagnostics
    timings_s: Mapping[str, float]


class VoxDepth(StreamCorrector):
    """The method of the paper: it corrects frames by a template, a new one in every epoch.

    An epoch fuses `window_frames` frames into one voxel cloud, projects it to a dense template, and then corrects
    frame after frame with the registered template until that no longer fits. While a window fills, the previous
    template corrects.

    Args:
        intrinsics: Intrinsics of the camera.
        config: Parameters; None for those of the paper.

    Raises:
        ConfigError: An argument has another type, or the configured device does not exist.
    """

    def __init__(self, intrinsics: Intrinsics, config: VoxDepthConfig | None = None) -> None:
        camera, config = intrinsics, checked_config(intrinsics, config, VoxDepthConfig)
        self._config = config
        registration = ChainedRegistration if config.chained else OrbRegistration
        self._registration = registration(config, camera.shape)
        self._epochs = Epochs(
            partial(
                fuse_window,
                grid=create_grid(config.device, config.voxels, camera),
                odometry=PhotometricOdometry(camera),
                inpaint=partial(dilated, size_px=config.dilation_px),
            ),
            self._registration.follows,
            config,
        )
        self._warped_m = np.empty(camera.shape, np.float32)
        compile_all()
        super().__init__(camera, config)

    def _forget(self) -> None:
        """Forget template and window; the next frame starts a new epoch."""
        self._epochs.reset()

    def close(self) -> None:
        """Wait for a fusion that is under way, and accept no more frames."""
        super().close()
        self._epochs.close()

    def _align(self, frame: Frame) -> Aligned:
        timer = StepTimer()
        with timer("describe"):
            features = self._registration.describe(frame.gray)
        with timer("take_template"):
            before = self._epochs.template
            template = self._epochs.begin(frame, features)
        with timer("register"):
            registration = (
                Registration(status=RegistrationStatus.NOT_TRIED)
                if template is None
                else self._registration.register(template.features, features)
            )
        epoch_end = self._epochs.end(frame, features, registration)
        diagnostics = VoxDepthDiagnostics(
            phase=self._epochs.phase(registration),
            registration=registration,
            epoch=self._epochs.number,
            new_epoch=template is not before,
            epoch_end=epoch_end,
            template=template,
        )
        return Aligned(frame=frame, diagnostics=diagnostics, timings_s=timer.times_s)

    def combine(self, aligned: Aligned) -> CorrectedDepth:
        """Correct the aligned frame, which depends on nothing else."""
        timer, registration = StepTimer(aligned.timings_s), aligned.diagnostics.registration
        measured_m, template = aligned.frame.depth_m, aligned.diagnostics.template if registration.ok else None
        depth_m, source_before = measured_m, (measured_m > 0).view(np.uint8)
        with timer("warp"):  # from the original, since repeated warps would mix edges
            if template is not None:
                depth_m = warped(template.depth_m, registration.M_frame_template, self._warped_m)
        with timer("merge"):
            if template is not None:
                source_before = np.empty_like(source_before)
                merge(measured_m, *self._config.bounds, depth_m, source_before)
        with timer("filter"):
            depth_m = np.asarray(cv2.medianBlur(depth_m, self._config.median_size_px), np.float32)
        with timer("label"):  # after the median has emptied some pixels and filled others
            source, confidence = np.empty_like(source_before), np.empty_like(depth_m)
            _label(depth_m, source_before, source, confidence)
        return CorrectedDepth(
            depth_m=depth_m,
            source=source,
            confidence=confidence,
            timings_s=timer.times_s,
            diagnostics=aligned.diagnostics,
        )


@compiled(void(READABLE_IMAGE, float32, float32, float32, FLOAT_IMAGE, BYTE_IMAGE))
def merge(
    raw_m: FloatImage,
    low: float,
    high: float,
    empty_from_m: float,
    # input and output
    depth_m: FloatImage,
    # output
    source: GrayImage,
) -> None:
    """Replace the invalid pixels of a frame by those of the template, and write one `Source` per pixel: Eq. depthcor.

    A pixel is kept within the bounds, and where the template is empty.

    Args:
        raw_m: Measured depth, shape (H, W); 0 = invalid.
        low: Share of the measured depth below which that of the template replaces it; see `VoxDepthConfig.bounds`.
        high: Multiple of it above which that of the template replaces it.
        empty_from_m: Measured depth from which on a pixel counts as empty.
        depth_m: The template in the pixels of the frame, shape (H, W), 0 = empty; overwritten by the result.
        source: One `Source` per pixel, shape (H, W); written.
    """
    for row in range(raw_m.shape[0]):
        for col in range(raw_m.shape[1]):
            measured_m, template_m = raw_m[row, col], depth_m[row, col]
            measured_m = measured_m if measured_m < empty_from_m else float32(0)
            is_near, is_far = template_m > measured_m * high, template_m < measured_m * low
            is_replaced = (template_m > 0) & (is_near | is_far)
            sensor = Source.SENSOR if measured_m > 0 else Source.INVALID
            depth_m[row, col] = template_m if is_replaced else measured_m
            source[row, col] = Source.MEMORY if is_replaced else sensor


@compiled(void(FLOAT_IMAGE, BYTE_IMAGE, BYTE_IMAGE, FLOAT_IMAGE))
def _label(
    depth_m: FloatImage,
    source_before: GrayImage,
    # output
    source: GrayImage,
    confidence: FloatImage,
) -> None:
    """Find source and confidence of each pixel after the median filter, which empties some pixels and fills others.

    Args:
        depth_m: Filtered depth, shape (H, W); 0 = invalid.
        source_before: One `Source` per pixel before the filter, shape (H, W).
        source: One `Source` per pixel, shape (H, W); written.
        confidence: Confidence, 0..1, shape (H, W); written.
    """
    for row in range(depth_m.shape[0]):
        for col in range(depth_m.shape[1]):
            before = source_before[row, col]
            filled = uint8(Source.INPAINTED) if before == Source.INVALID else before
            certain = SENSOR_CONFIDENCE if before == Source.SENSOR else OTHER_CONFIDENCE
            is_valid = depth_m[row, col] > 0
            source[row, col] = filled if is_valid else uint8(Source.INVALID)
            confidence[row, col] = certain if is_valid else float32(0)


def poses_in_last(window: Sequence[Frame], odometry: PhotometricOdometry) -> list[FloatArray | None]:
    """Return `T_last_frame`, shape (4, 4), of each frame of a window; None for a frame whose pose is not known.

    As in the paper, the motion between the first two frames holds for the whole window: frame i is `T^(n-1-i)` away
    from the last, which gives the cloud of the nested Eq. fuse up to voxel rounding. Without that motion only the last
    frame has a pose.
    """
    last = len(window) - 1
    T = motion_between(window[0], window[1], odometry) if last else None
    if T is None:
        return [*([None] * last), np.eye(4)]
    powers: list[FloatArray | None] = [np.eye(4)]
    power = np.eye(4)
    for _ in range(last):
        power = compose(power, T)
        powers.append(power)
    return powers[::-1]


def fuse_window(
    window: Sequence[Frame],
    features: Features,
    grid: "VoxelGrid | WarpVoxelGrid",
    odometry: PhotometricOdometry,
    inpaint: Inpaint,
) -> Template:
    """Fuse successive frames into a template in the camera of the last one.

    Frames without a pose are left out: they would smear.

    Args:
        window: The frames, at least one, in the order of time.
        features: Features of the last one.
        grid: A voxel grid, whose former content does not matter; it is for one window at a time.
        odometry: Finds the motion between the first two frames.
        inpaint: Makes the projection of the voxels dense.
    """
    timer = StepTimer()
    with timer("motion"):
        poses = poses_in_last(window, odometry)
    with timer("voxelise"):
        grid.clear()
        for frame, T_last_frame in zip(window, poses, strict=True):
            if T_last_frame is not None:
                grid.integrate(frame.depth_m, T_last_frame)
    with timer("project"):
        projection_m = grid.project()
    with timer("inpaint"):
        depth_m = inpaint(projection_m)
    return Template(
        depth_m=depth_m,
        projection_m=projection_m,
        voxels=grid.occupied(),
        stamp_s=window[-1].stamp_s,
        features=features,
        timings_s=timer.times_s,
    )


def dilated(sparse_m: FloatImage, size_px: int) -> FloatImage:
    """Give every pixel, filled or not, the maximum of its window: paper, Eq. dilate.

    Depth [m] has shape (H, W), 0 = unknown. A pixel stays empty if its whole window is empty. Every depth edge moves by
    half the window, the far side over the near one.
    """
    dense_m: FloatImage = cv2.dilate(sparse_m, np.ones((size_px, size_px), np.uint8))  # type: ignore[assignment]
    return dense_m


def create_grid(device: DeviceName, config: VoxelConfig, intrinsics: Intrinsics) -> "VoxelGrid | WarpVoxelGrid":
    """Create an empty grid on a device, or raise a `ConfigError`, see `require_device`."""
    require_device(device)
    if device == "cpu":
        return VoxelGrid(config, intrinsics)
    from .warp_voxels import WarpVoxelGrid

    return WarpVoxelGrid(config, intrinsics, device=device.removeprefix("warp-"))
