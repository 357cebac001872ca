"""What the paper's method must do, and its known faults."""

from functools import partial

import cv2
import numpy as np
import pytest

from tests.frames import textured
from voxdepth import Frame, Intrinsics, Source, VoxDepth, VoxDepthConfig
from voxdepth.devices import cuda_devices
from voxdepth.errors import ConfigError
from voxdepth.paper.epochs import EpochEnd, Phase
from voxdepth.paper.method import dilated
from voxdepth.paper.registration import RegistrationStatus

CAMERA = Intrinsics.from_hfov(width_px=320, height_px=180, hfov_deg=86)
CONFIG = VoxDepthConfig(window_frames=4, max_epoch_frames=20, fusion_lag_frames=0)
CELL_Z_M = CONFIG.voxels.cell_m[2]


texture = partial(textured, CAMERA.shape)


def flat(depth_m: float) -> np.ndarray:
    return np.full(CAMERA.shape, depth_m, np.float32)


def feed(corrector: VoxDepth, depths: list[np.ndarray], gray: np.ndarray, start_s: float = 0.0) -> list:
    return [corrector.process(Frame(stamp_s=start_s + 0.1 * i, gray=gray, depth_m=d)) for i, d in enumerate(depths)]


def feed_still(corrector: VoxDepth, depths: list[np.ndarray]) -> list:
    """With poses that say the camera stands still: odometry knows the scale of things, so depth must not be scaled."""
    frames = (Frame(stamp_s=0.1 * i, gray=texture(0), depth_m=d, T_world_cam=np.eye(4)) for i, d in enumerate(depths))
    return [corrector.process(frame) for frame in frames]


def test_it_passes_frames_through_until_the_first_template_is_there() -> None:
    results = feed(VoxDepth(CAMERA, CONFIG), [flat(10.0)] * 6, texture(0))
    assert [r.diagnostics.phase for r in results] == [Phase.PASSTHROUGH] * 3 + [Phase.CORRECTING] * 3
    assert results[0].diagnostics.registration.status is RegistrationStatus.NOT_TRIED


def test_flicker_is_removed_and_small_holes_are_closed() -> None:
    spotted = flat(10.0)
    spotted[::15, ::15], spotted[7::15, ::15] = 3.0, 0.0
    result = feed(VoxDepth(CAMERA, CONFIG), [spotted], texture(0))[0]
    assert np.abs(result.depth_m[5:-5, 5:-5] - 10.0).max() == 0
    np.testing.assert_array_equal(result.source == Source.INPAINTED, spotted == 0)


def test_scaling_depth_and_voxels_together_scales_the_output() -> None:
    rng = np.random.default_rng(0)
    depths = [(flat(9.0) + rng.uniform(-1, 1, CAMERA.shape)).astype(np.float32) for _ in range(6)]
    depths[5][60:120, 100:200] = 0
    voxels = CONFIG.voxels
    lengths = {name: 2 * getattr(voxels, name) for name in ("half_width_m", "half_height_m", "depth_m")}
    larger = voxels.model_copy(update=lengths | {"cell_m": tuple(2 * c for c in voxels.cell_m)})
    twice = CONFIG.model_copy(update={"voxels": larger})
    once = feed_still(VoxDepth(CAMERA, CONFIG), depths)
    doubled = feed_still(VoxDepth(CAMERA, twice), [2 * d for d in depths])
    for a, b in zip(once, doubled, strict=True):
        np.testing.assert_array_equal(2 * a.depth_m, b.depth_m)


@pytest.mark.parametrize("depth_m", [10.0, 17.3, 40.0])
def test_static_noise_free_planes_come_back_within_a_voxel(depth_m: float) -> None:
    result = feed(VoxDepth(CAMERA, CONFIG), [flat(depth_m)] * 5, texture(0))[-1]
    assert result.diagnostics.phase is Phase.CORRECTING
    assert np.abs(result.depth_m - depth_m).max() <= CELL_Z_M
    empty = Frame(stamp_s=9.0, gray=texture(0), depth_m=flat(0.0))
    template_alone = VoxDepth(CAMERA, CONFIG)
    feed(template_alone, [flat(depth_m)] * 5, texture(0))
    filled = template_alone.process(empty).depth_m
    seen = filled > 0  # the grid ends 16 m above and below the axis
    assert seen.mean() > (0.99 if depth_m < 30 else 0.7)
    assert np.abs(filled[seen] - depth_m).max() <= CELL_Z_M


def test_a_template_keeps_the_sparse_projection_that_was_inpainted_and_the_time_of_each_step() -> None:
    template = feed(VoxDepth(CAMERA, CONFIG), [flat(10.0)] * 4, texture(0))[-1].diagnostics.template
    np.testing.assert_array_equal(template.depth_m, dilated(template.projection_m, CONFIG.dilation_px))
    assert 0 < np.count_nonzero(template.projection_m) < np.count_nonzero(template.depth_m)
    assert list(template.timings_s) == ["motion", "voxelise", "project", "inpaint"]


def test_at_depth_steps_the_erosion_is_bounded_which_is_a_known_fault() -> None:
    """The dilation moves the far side over the near one by half its window, and the median by its radius more."""
    step = flat(40.0)
    step[40:140, 100:220] = 18.0
    result = feed(VoxDepth(CAMERA, CONFIG), [step] * 6, texture(0))[-1]
    lost_px = CONFIG.dilation_px // 2 + CONFIG.median_size_px // 2
    kept = np.s_[40 + lost_px : 140 - lost_px, 100 + lost_px : 220 - lost_px]
    assert np.abs(result.depth_m[kept] - 18.0).max() <= CELL_Z_M
    eroded = (result.depth_m > 30) & (step < 30)
    assert eroded.any()


def test_a_new_epoch_begins_after_a_cut_and_not_on_a_still_camera() -> None:
    corrector = VoxDepth(CAMERA, CONFIG)
    still = feed(corrector, [flat(10.0)] * 15, texture(0))
    assert {r.diagnostics.phase for r in still[3:]} == {Phase.CORRECTING}
    cut = feed(corrector, [flat(5.0)] * 8, texture(1), start_s=100.0)
    assert cut[0].diagnostics.registration.status is RegistrationStatus.FEW_MATCHES
    assert cut[0].diagnostics.phase is Phase.PASSTHROUGH
    assert [r.diagnostics.epoch_end for r in still] == [EpochEnd.NONE] * 15
    assert [r.diagnostics.epoch_end for r in cut] == [EpochEnd.FEW_MATCHES, *[EpochEnd.NONE] * 7]
    assert cut[-1].diagnostics.phase is Phase.CORRECTING
    assert np.abs(cut[-1].depth_m - 5.0).max() <= CELL_Z_M


@pytest.mark.parametrize("gray", [np.zeros(CAMERA.shape, np.uint8), np.full(CAMERA.shape, 255, np.uint8)])
def test_featureless_images_end_in_a_status(gray: np.ndarray) -> None:
    result = feed(VoxDepth(CAMERA, CONFIG), [flat(10.0)] * 6, gray)[-1]
    assert result.diagnostics.registration.status is RegistrationStatus.FEW_MATCHES
    np.testing.assert_array_equal(result.depth_m, flat(10.0))


def test_frames_without_any_depth_stay_empty() -> None:
    result = feed(VoxDepth(CAMERA, CONFIG), [flat(0.0)] * 6, texture(0))[-1]
    assert not result.depth_m.any()
    assert not result.confidence.any()
    assert (result.source == Source.INVALID).all()


def test_the_lag_delays_the_template_and_changes_nothing_else() -> None:
    depths = [(flat(10.0) + 0.01 * i).astype(np.float32) for i in range(12)]
    at_once = feed(VoxDepth(CAMERA, CONFIG), depths, texture(0))
    later = feed(VoxDepth(CAMERA, CONFIG.model_copy(update={"fusion_lag_frames": 2})), depths, texture(0))
    assert [r.diagnostics.phase for r in later] == [Phase.PASSTHROUGH] * 5 + [Phase.CORRECTING] * 7
    for a, b in zip(at_once[5:], later[5:], strict=True):
        np.testing.assert_array_equal(a.depth_m, b.depth_m)


def test_without_a_gpu_cuda_is_refused_in_one_line() -> None:
    if cuda_devices():
        pytest.skip("there is a GPU")
    with pytest.raises(ConfigError, match="no CUDA device"):
        VoxDepth(CAMERA, CONFIG.model_copy(update={"device": "cuda"}))


@pytest.mark.parametrize("device", ["cuda", "warp-cpu"])
def test_without_warp_what_needs_it_is_refused_in_one_line(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("voxdepth.devices.has_warp", lambda: False)
    with pytest.raises(ConfigError, match=f"'{device}' needs Warp: pip install"):
        VoxDepth(CAMERA, CONFIG.model_copy(update={"device": device}))


def test_warp_gives_the_bits_of_the_cpu() -> None:
    depths, gray = [flat(10.0)] * 5 + [flat(0.0)], texture(0)
    pytest.importorskip("warp")
    expected = feed(VoxDepth(CAMERA, CONFIG), depths, gray)[-1]
    found = feed(VoxDepth(CAMERA, CONFIG.model_copy(update={"device": "warp-cpu"})), depths, gray)[-1]
    assert (found.source == Source.MEMORY).mean() > 0.9
    np.testing.assert_array_equal(found.depth_m, expected.depth_m)
    np.testing.assert_array_equal(found.source, expected.source)


def approaching(start_m: float, step_m: float, n: int) -> list[Frame]:
    """A camera that moves straight towards a textured plane."""
    frames = []
    for i in range(n):
        distance_m = start_m - step_m * i
        scale, (height, width) = start_m / distance_m, CAMERA.shape
        cx, cy = CAMERA.cx_px, CAMERA.cy_px
        zoom = np.array([[scale, 0, cx - scale * cx], [0, scale, cy - scale * cy]])
        gray = cv2.warpAffine(texture(3), zoom, (width, height), borderMode=cv2.BORDER_REFLECT)
        frames.append(Frame(stamp_s=0.1 * i, gray=gray, depth_m=flat(distance_m)))
    return frames


def test_a_moving_camera_fuses_its_window_into_the_last_frame() -> None:
    config = VoxDepthConfig(window_frames=8, fusion_lag_frames=0)
    *window, last = approaching(10.0, 0.1, 8)
    corrector = VoxDepth(CAMERA, config)
    for frame in window:
        corrector.process(frame)
    hole = np.s_[40:140, 100:220]
    holed = last.depth_m.copy()
    holed[hole] = 0
    # What fills the hole comes from the other frames, moved to where the camera is: 9.3 m from the plane.
    depth_m = corrector.process(Frame(stamp_s=last.stamp_s, gray=last.gray, depth_m=holed)).depth_m[hole]
    assert (depth_m > 0).mean() > 0.95
    assert np.abs(depth_m[depth_m > 0] - 9.3).max() <= CELL_Z_M + 0.02


def test_the_template_grows_with_what_the_camera_comes_near_to() -> None:
    step = flat(10.0)
    step[:, 160:] = 0
    corrector = VoxDepth(CAMERA, CONFIG)
    feed(corrector, [step] * 4, texture(3))
    scale, (height, width) = 1.2, CAMERA.shape
    zoom = np.array([[scale, 0, 40 - scale * 40], [0, scale, CAMERA.cy_px - scale * CAMERA.cy_px]])  # about column 40
    gray = cv2.warpAffine(texture(3), zoom, (width, height), borderMode=cv2.BORDER_REFLECT)
    result = corrector.process(Frame(stamp_s=9.0, gray=gray, depth_m=flat(0.0)))
    assert result.diagnostics.registration.ok
    edge = int((result.depth_m[90] > 0).sum())
    assert abs(edge - (scale * (160 - 40) + 40)) < 8  # 184, and the dilation; the wrong way it would be 140


@pytest.mark.parametrize("cut_at", [1, 5, 6, 9, 15])
def test_a_cut_at_any_frame_leaves_no_depth_of_the_other_scene_behind(cut_at: int) -> None:
    corrector = VoxDepth(CAMERA, VoxDepthConfig(window_frames=6, fusion_lag_frames=2))
    feed(corrector, [flat(12.0)] * cut_at, texture(0))
    for result in feed(corrector, [flat(5.0)] * 20, texture(1), start_s=100.0):
        assert np.abs(result.depth_m - 5.0).max() <= CELL_Z_M


@pytest.mark.parametrize(
    "bad",
    [
        {"median_size_px": 4},
        {"dilation_px": 2},
        {"voxels": {"cell_m": (0.0, 0.1, 0.1)}},
        {"voxels": {"cell_m": (0.001, 0.001, 0.001)}},
    ],
)
def test_bad_configurations_are_refused(bad: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="validation error"):
        VoxDepthConfig(**bad)


def test_template_and_voxels_can_be_read() -> None:
    corrector = VoxDepth(CAMERA, CONFIG)
    first = feed(corrector, [flat(10.0)] * 3, texture(0))[-1].diagnostics
    assert (first.template, first.epoch) == (None, 0)
    started, later = (r.diagnostics for r in feed(corrector, [flat(10.0)] * 2, texture(0), start_s=1.0))
    assert [(d.epoch, d.new_epoch) for d in (started, later)] == [(1, True), (1, False)]
    assert started.template.stamp_s == 1.0
    points_m = started.template.voxels.centres_m
    assert np.abs(points_m[:, 2] - 10.0).max() <= CELL_Z_M
    right_m, bottom_m = np.array([CAMERA.width_px / CAMERA.fx_px, CAMERA.height_px / CAMERA.fy_px]) / 2 * 10.0
    np.testing.assert_allclose(np.abs(points_m[:, :2]).max(axis=0), [right_m, bottom_m], atol=0.2)
    assert np.abs(started.template.depth_m - 10.0).max() <= CELL_Z_M


def test_a_template_is_shown_as_it_was_used() -> None:
    corrector = VoxDepth(CAMERA, CONFIG)
    feed(corrector, [flat(10.0)] * 5, texture(0))
    result = feed(corrector, [flat(0.0)], texture(0), start_s=1.0)[0]
    used = result.source == Source.MEMORY
    assert used.mean() > 0.9
    assert (result.confidence[used] < 1).all()
    np.testing.assert_array_equal(result.depth_m[used], result.diagnostics.warped_template_m[used])
    assert feed(VoxDepth(CAMERA, CONFIG), [flat(10.0)], texture(0))[0].diagnostics.warped_template_m is None
