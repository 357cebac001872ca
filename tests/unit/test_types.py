"""Frames and cameras refuse what they cannot be."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from voxdepth import Frame, Intrinsics
from voxdepth.errors import FrameError

GRAY = np.zeros((4, 6), np.uint8)
DEPTH = np.ones((4, 6), np.float32)


@pytest.mark.parametrize(
    ("gray", "depth", "message"),
    [
        (GRAY.astype(np.float32), DEPTH, "gray must be uint8"),
        (np.zeros((4, 6, 3), np.uint8), DEPTH, "gray must be uint8"),
        (GRAY, DEPTH[:, :5], "depth_m must be float32 of shape"),
        (GRAY, (1000 * DEPTH).astype(np.uint16), "see Frame.from_millimetres"),
        (GRAY, np.where(DEPTH > 0, np.nan, DEPTH).astype(np.float32), "replace what is not by 0"),
        (GRAY, -DEPTH, "negative"),
        (GRAY, DEPTH * np.float32(np.inf), "finite"),
        (GRAY[:0], DEPTH[:0], "empty"),
        (GRAY.tolist(), DEPTH, "must be arrays"),
        (GRAY, None, "must be arrays"),
    ],
)
def test_bad_frames_are_refused(gray: Any, depth: Any, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        Frame(stamp_s=0.0, gray=gray, depth_m=depth)


@pytest.mark.parametrize(
    ("create", "message"),
    [
        (lambda: Frame(stamp_s="0", gray=GRAY, depth_m=DEPTH), "stamp_s must be a number, got '0' of type str"),
        (lambda: Intrinsics.from_hfov(width_px="64", height_px=48, hfov_deg=80), "width_px must be a whole number"),
        (lambda: Intrinsics.from_hfov(width_px=64, height_px=48.5, hfov_deg=80), "height_px must be a whole number"),
        (lambda: Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=True), "hfov_deg must be a number"),
        (
            lambda: Frame.from_units(stamp_s=0, gray=GRAY, depth=DEPTH.astype(np.uint16), units_per_m="1000"),
            "units_per_m must be a number",
        ),
    ],
)
def test_values_of_another_type_are_refused_by_name(create: Callable[[], object], message: str) -> None:
    with pytest.raises(FrameError, match=message):
        create()


@pytest.mark.parametrize("number", [np.float32(1.5), np.int64(2), 3, 0.5])
def test_numbers_of_numpy_become_numbers_of_python(number: Any) -> None:
    stamp_s = Frame(stamp_s=number, gray=GRAY, depth_m=DEPTH).stamp_s
    assert stamp_s == number
    assert type(stamp_s) in (int, float)
    fx_px = Intrinsics(fx_px=number, fy_px=2.0, cx_px=1.0, cy_px=1.0, width_px=6, height_px=4).fx_px
    assert fx_px == number
    assert type(fx_px) in (int, float)


@pytest.mark.parametrize("create", [
    lambda masked: Frame(stamp_s=0.0, gray=GRAY, depth_m=masked),
    lambda masked: Frame.from_metres(stamp_s=0.0, gray=GRAY, depth_m=masked),
    lambda masked: Frame.from_millimetres(stamp_s=0.0, gray=GRAY, depth_mm=masked.astype(np.uint16)),
])  # fmt: skip
def test_a_masked_array_is_refused_since_its_hidden_values_would_count(create: Callable[[Any], Frame]) -> None:
    hidden = np.ma.masked_invalid(np.where(np.eye(4, 6) > 0, np.nan, 1).astype(np.float32)).filled(np.nan)
    masked = np.ma.array(np.nan_to_num(hidden, nan=9.0), mask=np.isnan(hidden))
    with pytest.raises(FrameError, match="masked array"):
        create(masked)


@pytest.mark.parametrize("reorder", [np.asfortranarray, lambda image: np.rot90(image, 2), lambda image: image.T])
def test_images_of_any_memory_order_become_rows_with_the_same_pixels(reorder: Callable[[Any], Any]) -> None:
    depth_m = np.arange(24, dtype=np.float32).reshape(4, 6)
    frame = Frame(stamp_s=0.0, gray=reorder(GRAY), depth_m=reorder(depth_m))
    assert frame.gray.flags.c_contiguous and frame.depth_m.flags.c_contiguous
    np.testing.assert_array_equal(frame.depth_m, reorder(depth_m))
    assert Frame(stamp_s=0.0, gray=GRAY, depth_m=depth_m).depth_m is depth_m, "rows are not copied"


def test_intrinsics_from_hfov_see_that_angle() -> None:
    camera = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86)
    left, right = (-0.5 - camera.cx_px) / camera.fx_px, (639.5 - camera.cx_px) / camera.fx_px
    assert np.isclose(np.degrees(np.arctan(right) - np.arctan(left)), 86)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"fx_px": np.nan}, "are they in pixels"),
        ({"cx_px": np.nan}, "far outside of an image"),
        ({"fy_px": np.inf}, "are they in pixels"),
        ({"fx_px": -1.0}, "are they in pixels"),
        ({"fx_px": 1e-6}, "are they in pixels"),
        ({"fy_px": -80.0}, r"fy_px must be positive, got -80.0: .*as in ICL-NUIM, it is 80.0"),
        ({"fy_px": 1e9}, "are they in pixels"),
        ({"cx_px": 999.0}, "far outside of an image"),
        ({"cy_px": -150.0}, "far outside of an image"),
        ({"width_px": 0}, "1 to 65536 pixels a side"),
        ({"height_px": 10**6}, "1 to 65536 pixels a side"),
        ({"baseline_m": np.nan}, "is it in metres"),
        ({"baseline_m": 0.0}, "is it in metres"),
        ({"baseline_m": 50.0}, "is it in metres"),
        ({"disparity_scale": 1e300}, "disparity_scale must be"),
        ({"disparity_scale": 0.0}, "disparity_scale must be"),
    ],
)
def test_intrinsics_that_do_not_fit_the_image_are_refused(bad: dict[str, float], message: str) -> None:
    good = {"fx_px": 80.0, "fy_px": 80.0, "cx_px": 63.5, "cy_px": 47.5, "width_px": 128, "height_px": 96}
    with pytest.raises(FrameError, match=message):
        Intrinsics(**(good | bad))


@pytest.mark.parametrize("width_px", [640, 848, 1280])
@pytest.mark.parametrize("fx_px", [87.0, 69.4, 90, 1.5])
def test_an_angle_in_place_of_a_focal_length_is_refused(fx_px: float, width_px: int) -> None:
    lens: dict[str, Any] = {"cx_px": 320.0, "cy_px": 240.0, "width_px": width_px, "height_px": 480}
    with pytest.raises(FrameError, match=r"is a field of view of 1\d\d degrees: is it an angle.*from_hfov takes"):
        Intrinsics(fx_px=fx_px, fy_px=58.0, **lens)
    for hfov_deg in (86, 150, 169):
        Intrinsics.from_hfov(width_px=width_px, height_px=480, hfov_deg=hfov_deg)


@pytest.mark.parametrize("hfov_deg", [1.204, 0.9, 3.14])
def test_a_field_of_view_in_radians_is_refused(hfov_deg: float) -> None:
    with pytest.raises(FrameError, match="is it in radians"):
        Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=hfov_deg)


@pytest.mark.parametrize("per_s", [1e3, 1e6, 1e9])
def test_times_in_other_units_than_seconds_are_refused(per_s: float) -> None:
    with pytest.raises(FrameError, match=r"number of seconds.*is it in nanoseconds, .*Divide it"):
        Frame(stamp_s=1.7e9 * per_s, gray=GRAY, depth_m=DEPTH)
    assert Frame(stamp_s=1.7e9, gray=GRAY, depth_m=DEPTH).stamp_s == 1.7e9


@pytest.mark.parametrize("hfov_deg", [180.0, 175.0, -1.0])
def test_a_field_of_view_that_no_pinhole_camera_has_is_refused(hfov_deg: float) -> None:
    with pytest.raises(FrameError, match="field of view must lie in"):
        Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=hfov_deg)


class CameraInfo:
    """A message as ROS 2 has it."""

    def __init__(self, **fields: object) -> None:
        self.width, self.height = 640, 360
        self.p = [343.0, 0, 319.5, 0, 0, 344.0, 179.5, 0, 0, 0, 1, 0]
        self.__dict__.update(fields)


@pytest.mark.parametrize("translation_m", [(-0.059, 0.0, -3e-4), (-0.059, 2e-4, 0.0), (0.0147, 0.0, 0.0)])
def test_a_translation_to_another_camera_is_no_baseline(translation_m: tuple[float, float, float]) -> None:
    x, y, z = translation_m
    beside_colour = CameraInfo(p=[343.0, 0, 319.5, x, 0, 344.0, 179.5, y, 0, 0, 1, z])
    assert Intrinsics.from_camera_info(beside_colour).baseline_m is None


class Roi:
    """Part of an image."""

    width, height = 320, 180


@pytest.mark.parametrize(
    "bad",
    [
        object(),
        CameraInfo(p=[0.0] * 12),
        CameraInfo(p=[1.0] * 9),
        CameraInfo(width=0),
        CameraInfo(binning_x=2, binning_y=2),
        CameraInfo(roi=Roi()),
    ],
)
def test_other_messages_are_refused(bad: object) -> None:
    with pytest.raises(FrameError):
        Intrinsics.from_camera_info(bad)


def test_millimetres_and_other_units_become_metres() -> None:
    gray, depth_mm = np.zeros((1, 3), np.uint8), np.array([[0, 1500, 65535]], np.uint16)
    frame = Frame.from_millimetres(stamp_s=0.0, gray=gray, depth_mm=depth_mm)
    np.testing.assert_allclose(frame.depth_m, [[0, 1.5, 0]], rtol=1e-6)
    fine = Frame.from_units(stamp_s=0.0, gray=gray, depth=depth_mm.astype(">u2"), units_per_m=5000)
    np.testing.assert_allclose(fine.depth_m, [[0, 0.3, 0]], rtol=1e-6)
    with pytest.raises(FrameError, match=r"Frame\.from_metres"):
        Frame.from_millimetres(stamp_s=0.0, gray=gray, depth_mm=depth_mm.astype(np.float32))


@pytest.mark.parametrize("kind", ["<f2", ">f2", "<f4", ">f4", "<f8", ">f8"])
def test_metres_as_ros_writes_them_have_holes_where_they_are_not_finite(kind: str) -> None:
    gray, depth_m = np.zeros((1, 4), np.uint8), np.array([[np.nan, 1.5, np.inf, -np.inf]], kind)
    frame = Frame.from_metres(stamp_s=0.0, gray=gray, depth_m=depth_m)
    np.testing.assert_array_equal(frame.depth_m, np.array([[0, 1.5, 0, 0]], np.float32))
    with pytest.raises(FrameError, match="negative"):
        Frame.from_metres(stamp_s=0.0, gray=gray, depth_m=-np.ones((1, 4), kind))
    with pytest.raises(FrameError, match="from_millimetres"):
        Frame.from_metres(stamp_s=0.0, gray=GRAY, depth_m=np.ones((4, 6), np.uint16))


@pytest.mark.parametrize(
    "bad",
    [
        *({"stamp_s": stamp_s} for stamp_s in (np.nan, np.inf, 10**400, 1j, "now", None, np.datetime64("now"))),
        *({"T_world_cam": T} for T in (np.eye(3), np.full((4, 4), np.nan), np.eye(4).tolist(), "pose", np.eye(4) * 1j)),
        *({"T_world_cam": T} for T in (np.eye(4, dtype=object), np.ma.masked_equal(np.eye(4), 0), 1e39 * np.eye(4))),
        {"T_world_cam": np.diag([1.0, -1.0, 1.0, 1.0])},
    ],
)
def test_times_and_poses_must_be_finite(bad: dict[str, object]) -> None:
    with pytest.raises(FrameError, match=r"(stamp_s|T_world_cam) must be"):
        Frame(**({"stamp_s": 0.0, "gray": GRAY, "depth_m": DEPTH} | bad))


@pytest.mark.parametrize("share_near", [0.0, 0.04, 0.4])
@pytest.mark.parametrize("make", [Frame, Frame.from_metres])
def test_floats_in_millimetres_get_a_warning_whatever_a_few_pixels_show(
    make: Callable[..., Frame], share_near: float
) -> None:
    rng = np.random.default_rng(0)
    depth_mm = rng.uniform(700, 6000, (20, 30)).astype(np.float32)
    depth_mm[rng.random(depth_mm.shape) < share_near] = 180
    with pytest.warns(UserWarning, match=r"the median of depth_m is .* millimetres\?"):
        make(stamp_s=0, gray=np.zeros((20, 30), np.uint8), depth_m=depth_mm)


def test_metres_with_some_sky_get_no_warning() -> None:
    depth_m = np.full((20, 30), 80, np.float32)
    depth_m[:9], depth_m[9] = 1000, 0
    Frame(stamp_s=0, gray=np.zeros((20, 30), np.uint8), depth_m=depth_m)
    Frame(stamp_s=0, gray=GRAY, depth_m=0 * DEPTH)


@pytest.mark.parametrize("size", [(320, 240), (213, 160), (640, 480)])
def test_an_image_that_is_resized_after_matching_keeps_the_error_of_its_depth(size: tuple[int, int]) -> None:
    camera = Intrinsics.from_hfov(width_px=640, height_px=480, hfov_deg=80, baseline_m=0.1)
    small, x, y = camera.scaled(*size), 0.3, -0.2
    assert small.focal_baseline_px_m == pytest.approx(camera.focal_baseline_px_m)
    u, v = camera.fx_px * x + camera.cx_px, camera.fy_px * y + camera.cy_px
    assert small.fx_px * x + small.cx_px == pytest.approx((u + 0.5) * size[0] / 640 - 0.5)
    assert small.fy_px * y + small.cy_px == pytest.approx((v + 0.5) * size[1] / 480 - 0.5)


@pytest.mark.parametrize(("max_width_px", "shape"), [(320, (182, 320)), (1, (1, 1)), (1000, (363, 640))])
def test_an_image_is_reduced_to_a_width_with_its_aspect_ratio(max_width_px: int, shape: tuple[int, int]) -> None:
    camera = Intrinsics.from_hfov(width_px=640, height_px=363, hfov_deg=80)
    assert camera.reduced(max_width_px).shape == shape
