"""The RealSense baselines: what each filter does, and equality with librealsense itself."""

from typing import Any

import numpy as np
import pytest

from tests.realsense_files import software_camera, through
from voxdepth.baselines.realsense import RealSenseChain, fill_farthest, fill_from_left
from voxdepth.errors import ConfigError
from voxdepth.types import Frame, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=86, baseline_m=0.095)


def frame_of(depth_m: Any, stamp_s: float = 0.0) -> Frame:
    image = np.array(depth_m, np.float32)
    return Frame(stamp_s=stamp_s, gray=np.zeros(image.shape, np.uint8), depth_m=image)


def moving_scene(n_frames: int) -> list[np.ndarray]:
    """Depth [mm], uint16, of a slanted wall behind a moving box with its shadow, with noise, flicker and gaps."""
    rng = np.random.default_rng(7)
    row, col = np.mgrid[0:72, 0:96]
    frames = []
    for k in range(n_frames):
        z = 3 + 0.05 * col + 0.02 * row
        z[20:50, 30 + 2 * k : 60 + 2 * k] = 1.5
        z += rng.normal(0, 0.006, z.shape) * z**2
        z[rng.random(z.shape) < 0.15] = 0
        z[20:50, 20 + 2 * k : 30 + 2 * k] = 0
        z[:, :8] = 0
        z[60:64] = 0
        z[66:, 50:] = rng.uniform(0, 65, (6, 46))
        z[:3, 50:] = 65.535
        frames.append(np.clip(np.rint(z * 1000), 0, 65535).astype(np.uint16))
    frames[-3][:] = 0
    return frames


def test_the_chain_needs_the_baseline() -> None:
    camera = Intrinsics.from_hfov(width_px=96, height_px=72, hfov_deg=86)
    with pytest.raises(ConfigError, match="name it as baseline_m"):
        RealSenseChain(camera)


@pytest.mark.filterwarnings("ignore:the median of depth_m")
@pytest.mark.parametrize("beyond_m", [65.6, 90.0, 3e38])
def test_the_chain_cuts_depths_that_16_bits_cannot_hold(beyond_m: float) -> None:
    depth_m = RealSenseChain(CAMERA).process(frame_of(np.full(CAMERA.shape, beyond_m))).depth_m
    np.testing.assert_allclose(depth_m, 65.535, rtol=1e-6)


# librealsense


@pytest.mark.parametrize(("mode", "fill"), enumerate([fill_from_left, fill_farthest]))
def test_hole_filling_equals_that_of_librealsense(mode: int, fill: Any) -> None:
    sdk = software_camera(CAMERA)
    block = sdk.rs.hole_filling_filter(mode)
    for units in moving_scene(5):
        expected, filled_m = through(sdk, units, [block]), (units / 1000).astype(np.float32)
        fill(filled_m)
        np.testing.assert_array_equal(np.rint(filled_m * 1000), expected)
        assert (expected != units).any() == units.any()


def test_the_chain_equals_that_of_librealsense() -> None:
    sdk, chain = software_camera(CAMERA), RealSenseChain(CAMERA)
    blocks = sdk.recommended_filters()
    for units in moving_scene(14):
        result_m = chain.process(frame_of(units / 1000)).depth_m
        np.testing.assert_array_equal(np.rint(result_m * 1000), through(sdk, units, blocks))
