"""The unit of depth: values become metres in one way, and those that contradict the usual unit are questioned."""

import numpy as np
import pytest

from voxdepth.errors import FrameError
from voxdepth.units import FAR_M, Unit, median_m

ROOM_M = np.random.default_rng(0).uniform(0.6, 6.0, (30, 40))


@pytest.mark.parametrize("units_per_m", [1, 256.0, np.float32(10_000)])
@pytest.mark.parametrize("kind", ["<u2", ">u2", "<i4", "<f4", ">f8"])
def test_a_stated_unit_holds_for_every_type(units_per_m: float, kind: str) -> None:
    stored = (units_per_m * np.minimum(ROOM_M, 6)).astype(kind)
    depth_m = Unit(units_per_m).metres(stored)
    assert depth_m.dtype == np.float32 and depth_m.flags.c_contiguous
    np.testing.assert_allclose(depth_m, stored.astype(float) / float(units_per_m), rtol=1e-6)


@pytest.mark.parametrize(("kind", "steps"), [("<u2", 1000), ("<f2", 1), ("<f4", 1)])
def test_the_usual_unit_is_the_millimetre_for_whole_numbers_and_the_metre_for_floats(kind: str, steps: int) -> None:
    np.testing.assert_allclose(Unit().metres((steps * ROOM_M).astype(kind)), ROOM_M, rtol=3e-3)


def test_what_is_no_depth_becomes_zero_and_what_is_negative_stays() -> None:
    stored = np.array([[np.nan, np.inf, -np.inf, 65535, 0, 65534, -2, 1e300]])
    np.testing.assert_array_equal(Unit(1).metres(stored), np.array([[0, 0, 0, 0, 0, 65534, -2, 0]], np.float32))
    assert not Unit(1000).metres(np.full((2, 2), 65535, np.uint16)).any()
    assert not Unit(1000).metres(np.full((2, 2), 65535, np.int64)).any()


def test_the_largest_number_of_16_bits_is_a_depth_among_larger_ones() -> None:
    micrometres = np.array([[65535, 65536, 900_000, 0]], np.uint32)
    np.testing.assert_allclose(Unit(1e6).metres(micrometres), [[0.065535, 0.065536, 0.9, 0]], rtol=1e-6)


@pytest.mark.parametrize(
    ("stored", "assumed"),
    [
        (1000 * ROOM_M, Unit()),
        (1000 * ROOM_M.astype(np.float32), Unit()),
        (ROOM_M.astype(np.uint16), Unit()),
        (ROOM_M / 1000, Unit()),
        (1e6 * ROOM_M, Unit()),
        ((300 * ROOM_M).astype(np.uint16), Unit(5000, is_known=False, least_m=0.4)),
    ],
)
def test_values_that_contradict_an_assumed_unit_are_asked_about_in_spite_of_specks(
    stored: np.ndarray, assumed: Unit
) -> None:
    specked = stored.copy()
    specked[::7, ::5] = 2 if stored.dtype.kind == "f" else 2000
    for values in (stored, specked):
        with pytest.raises(FrameError, match=r"expected a median depth of .*; state units_per_m"):
            assumed.metres(values)
        Unit(1000).metres(values)


@pytest.mark.parametrize("range_m", [(1.5, 60), (0.6, 2), (3, 1000), (100, 1250)])
def test_bits_of_floats_are_not_taken_for_millimetres(range_m: tuple[float, float]) -> None:
    floats = np.geomspace(*range_m, 1200, dtype=np.float16).reshape(30, 40)
    floats[0, :5] = np.inf, np.inf, 65504, 0, 0
    bits, usual = floats.view(np.uint16), Unit(may_be_halves=True)
    with pytest.raises(FrameError, match=r"floats of 16 bits of .* to inf m, .*: state units_per_m = 1000"):
        usual.metres(bits)
    np.testing.assert_array_equal(Unit(1000, may_be_halves=False).metres(bits), bits.astype(np.float32) / 1000)
    for other in (0, 2000):  # A renderer leaves no holes, and what is in millimetres begins nearer.
        usual.metres(np.where(floats < np.quantile(floats, 0.05), other, bits))


@pytest.mark.parametrize(
    ("unit", "stored", "message"),
    [
        (Unit(convention="X has it"), (1000 * ROOM_M).astype(np.uint16), "has depth in millimetres, as X has it, 3"),
        (Unit(convention="X has it"), ROOM_M.astype(np.float32), "has depth in metres, as X"),
        (Unit(100, convention="X"), (100 * ROOM_M).astype(np.uint16), "depth in centimetres"),
        (Unit(256, convention="X"), (256 * ROOM_M).astype(np.uint16), "depth in steps of 1/256 m"),
    ],
)
def test_how_an_image_is_read_is_reported_with_its_median(unit: Unit, stored: np.ndarray, message: str) -> None:
    assert message in unit.description(stored)
    assert " m in the median of its first image; if that is wrong, state --units-per-m" in unit.description(stored)


def test_an_image_without_depth_contradicts_nothing() -> None:
    for kind in (np.uint16, np.float32):
        assert not Unit().metres(np.zeros((3, 4), kind)).any()


@pytest.mark.parametrize("units_per_m", [0, 0.001, -1000, 1e7, np.nan, np.inf, "1000", [1000]])
def test_a_unit_that_makes_no_sense_is_refused(units_per_m: object) -> None:
    with pytest.raises(FrameError, match="units_per_m must be a number of 1 to 1,000,000"):
        Unit(units_per_m)


def test_the_median_of_large_images_is_nearly_that_of_all_pixels() -> None:
    depth_m = np.random.default_rng(1).gamma(2, 3, (480, 640)).astype(np.float32)
    depth_m[:100] = 0
    assert median_m(depth_m) == pytest.approx(float(np.median(depth_m[100:])), rel=0.05)
    assert median_m(np.zeros((2, 2), np.float32)) == 0 and median_m(np.full((2, 2), FAR_M, np.float32)) == FAR_M
