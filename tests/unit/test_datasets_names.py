"""Order and pairs by file name: the time or number that the names say, whatever their format, or a refusal."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sequences import CAMERA, SHAPE, write_images
from voxdepth.datasets import open_dataset
from voxdepth.datasets.names import in_order
from voxdepth.errors import DatasetError

BEGIN = datetime(2024, 2, 28, 23, 59, 59, 880_000, tzinfo=UTC)
"""Before the end of a second, a minute, a day and, in a leap year, no month."""
STEP_US = 33_333


def dates(format: str) -> Callable[[int], str]:
    return lambda us: (BEGIN + timedelta(microseconds=us)).strftime(format)


def milliseconds(format: str) -> Callable[[int], str]:
    return lambda us: dates(format)(us)[:-3]


def epoch_us(us: int) -> int:
    return round(BEGIN.timestamp()) * 10**6 - 120_000 + us


TIMES: dict[str, Callable[[int], str]] = {
    "date, microseconds": dates("%Y-%m-%d-%H-%M-%S-%f"),
    "date, milliseconds": milliseconds("%Y_%m_%d_%H_%M_%S_%f"),
    "compact date, milliseconds": milliseconds("%Y%m%d%H%M%S%f"),
    "compact date, microseconds": dates("%Y%m%d%H%M%S%f"),
    "phone": milliseconds("IMG_%Y%m%d_%H%M%S%f_cam2"),
    "iso": milliseconds("cam0-%Y-%m-%dT%H:%M:%S.%f+00:00"),
    "date, unpadded": lambda us: dates("%Y-%m-%d-%H-%M-%S-")(us) + str((epoch_us(us) // 1000) % 1000),
    "dotted date, unpadded": lambda us: dates("%Y.%m.%d.%H.%M.%S.")(us) + str((epoch_us(us) // 1000) % 1000),
    "s, ms": lambda us: f"left-{epoch_us(us) // 10**6}-{epoch_us(us) // 1000 % 1000:03d}",
    "s, us": lambda us: f"{epoch_us(us) // 10**6}_{epoch_us(us) % 10**6:06d}",
    "s, us, unpadded": lambda us: f"{epoch_us(us) // 10**6}_{epoch_us(us) % 10**6}",
    "s, ns, unpadded": lambda us: f"{epoch_us(us) // 10**6}_{epoch_us(us) % 10**6 * 1000}",
    "decimal s": lambda us: f"{epoch_us(us) / 1e6:.6f}",
    "decimal s as Python prints it": lambda us: str(epoch_us(us) / 1e6),
    "decimal ms": lambda us: f"depth_{epoch_us(us) / 1e3:.3f}",
    "ms": lambda us: f"{epoch_us(us) // 1000}",
    "us": lambda us: f"{epoch_us(us)}",
    "ns": lambda us: f"frame{epoch_us(us)}000",
}
"""How recorders write the time that is some microseconds after the beginning."""


@pytest.mark.parametrize("form", TIMES)
@pytest.mark.parametrize("counted", ["{1}", "{:06d}_{}", "frame{}-{}", "{1}_{0}"])
def test_names_with_a_time_are_in_its_order_at_its_distances_also_with_a_count(counted: str, form: str) -> None:
    us = [k * STEP_US for k in range(12)]
    paths = [Path("depth") / f"{counted.format(k + 8, TIMES[form](t))}.png" for k, t in enumerate(us)]
    named = in_order(sorted(paths))
    assert named.are_times and [path for _, path in named.files] == paths
    since_s = [(time_ns - named.files[0][0]) / 1e9 for time_ns, _ in named.files]
    np.testing.assert_allclose(since_s, np.array(us) / 1e6, atol=1.1e-3)


@pytest.mark.parametrize("parts", [(16_667, 50_000), (16_667_000, 50_000_000)])
def test_parts_of_five_or_eight_digits_are_whole_because_no_decimals_have_as_many(parts: tuple[int, int]) -> None:
    named = in_order([Path(f"1699187734_{part}.png") for part in parts])
    assert [time_ns % 10**9 for time_ns, _ in named.files] == [16_667_000, 50_000_000]


@given(st.lists(st.integers(0, 10**12), min_size=2, max_size=9, unique=True))
@pytest.mark.parametrize("form", ["date, microseconds", "compact date, microseconds", "s, us", "us"])
def test_any_times_are_in_order(form: str, us: list[int]) -> None:
    named = in_order([Path(f"{TIMES[form](t)}.png") for t in us])
    assert [path.stem for _, path in named.files] == [TIMES[form](t) for t in sorted(us)]


@pytest.mark.parametrize(
    "form",
    [
        *("{}", "frame{}", "cam0_{}", "2011_09_26_drive_0002_sync_{}_image_02", "{:03d}", "{}_depth"),
        *("20231105_123534_{:04d}", "20231105_123534_{:06d}", "2023-11-05-12-35-34_depth_{:04d}"),
        *("1699187734_{:04d}", "exp0.1_{:06d}", "1699187734_depth_{:06d}"),
    ],
)
def test_names_with_a_number_are_in_its_order(form: str) -> None:
    numbers = [8, 9, 10, 11, 99, 100, 101]
    named = in_order(sorted(Path(f"{form.format(number)}.png") for number in numbers))
    assert not named.are_times and [number for number, _ in named.files] == numbers


@pytest.mark.parametrize(
    "stems",
    [
        ["left_01", "left_02", "right_01", "right_02"],
        ["000000_10", "000000_11", "000001_10", "000001_11"],
        ["cam0_1", "cam0_2", "cam1_1", "cam1_2"],
        ["1a", "1b", "1c", "20"],
        ["deadbeef", "cafe0001", "00c0ffee"],
        ["depth1", "Depth2", "img3"],
        ["05-11-2023-12-35-34-900", "05-11-2023-12-35-35-033"],
        ["12-35-34-900", "12-35-35-033"],
        ["2023-11-05-12-35-34-900", "2023-13-05-12-35-35-033"],
        ["20231105_123534_900_a", "20231105_123535_033_b"],
        ["1.9", "2.10", "2.0"],
        ["-1", "0", "1"],
        ["2_1699187734.9", "1_1699187735.9"],
        ["cam0_1699187734900", "cam1_1699187734901", "cam0_1699187734902"],
        ["a1_b2_1699187734.9", "a2_b3_1699187735.9"],
        ["1699187734", "1699187734900"],
        ["5", "1699187734900"],
    ],
)
def test_names_that_say_no_one_order_are_refused_with_what_is_expected(stems: list[str]) -> None:
    with pytest.raises(DatasetError, match=r"expected names that differ in one number or time only, got"):
        in_order([Path(f"depth/{stem}.png") for stem in stems])


@pytest.mark.parametrize("stems", [["1", "01"], ["20231105_123534", "2023-11-05-12-35-34"]])
def test_names_that_say_the_same_are_refused(stems: list[str]) -> None:
    with pytest.raises(DatasetError, match=r"have one number|differ in one number"):
        in_order([Path(f"depth/{stem}.png") for stem in stems])


def write(folder: Path, depth: list[tuple[str, int]], gray: list[tuple[str, int]]) -> None:
    """Images of the values, which identify the images of a frame."""
    for name, images, kind in (("depth", depth, np.uint16), ("color", gray, np.uint8)):
        write_images(folder, {f"{name}/{stem}.png": np.full(SHAPE, value, kind) for stem, value in images})


@pytest.mark.parametrize("form", list(TIMES)[::4])
def test_an_image_that_is_missing_shifts_no_pair_and_is_reported(tmp_path: Path, form: str) -> None:
    stems = [(TIMES[form](k * STEP_US), k) for k in range(9)]
    depth = [(stem, 1000 + k) for stem, k in stems if k != 2]
    write(tmp_path, depth, [(stem, 10 * k) for stem, k in stems if k != 6])
    with pytest.warns(UserWarning, match="1 of 8 depth images have no gray image within 8 ms"):
        dataset = open_dataset(tmp_path, intrinsics=CAMERA, within_s=0.008)
    frames = [dataset[index] for index in range(len(dataset))]
    pairs = [(round(1000 * float(frame.depth_m[0, 0])) - 1000, int(frame.gray[0, 0]) // 10) for frame in frames]
    assert pairs == [(k, k) for k in (0, 1, 3, 4, 5, 7, 8)]


def test_numbers_pair_whatever_their_padding(tmp_path: Path) -> None:
    write(tmp_path, [(f"d{k}", 1000 + k) for k in (9, 10, 11)], [(f"{k:06d}_c", k) for k in (9, 10, 11)])
    dataset = open_dataset(tmp_path, intrinsics=CAMERA)
    assert [int(dataset[index].gray[0, 0]) for index in range(3)] == [9, 10, 11]
    assert [round(1000 * float(dataset[index].depth_m[0, 0])) for index in range(3)] == [1009, 1010, 1011]
    assert [dataset.name(index) for index in range(3)] == ["000000", "000001", "000002"]
