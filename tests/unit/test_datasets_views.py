"""Datasets from a later frame on and with poses of a file: what is given, and what is refused."""

from pathlib import Path

import numpy as np
import pytest

from tests.sequences import CAMERA, depth_of, gray_of, write_images
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.datasets.views import Later, Posed
from voxdepth.errors import ConfigError, DatasetError

N = 5
TURNED = "0 0 0.70710678 0.70710678"
"""A quarter turn about z, xyzw."""


@pytest.fixture
def dataset(tmp_path: Path) -> Dataset:
    for k in range(N):
        write_images(tmp_path, {f"depth/{k}.png": depth_of(k), f"color/{k}.png": gray_of(k)})
    return open_dataset(tmp_path, intrinsics=CAMERA, units_per_m=1000)


def test_a_later_beginning_keeps_names_times_and_images(dataset: Dataset) -> None:
    later = Later(dataset, 2)
    assert len(later) == 3 and [later.name(k) for k in range(3)] == ["2", "3", "4"]
    assert later.header(0) == dataset.header(2) and later[0].stamp_s == dataset[2].stamp_s
    np.testing.assert_array_equal(later[-1].gray, gray_of(4))
    with pytest.raises(IndexError):
        later[3]
    for start in (-1, N, 99):
        with pytest.raises(ConfigError, match=f"expected a first frame of 0 to 4, got {start}"):
            Later(dataset, start)


def test_poses_are_those_of_nearest_time_also_of_a_faster_clock_and_may_lack(dataset: Dataset, tmp_path: Path) -> None:
    lines = [f"{k / 90 + 0.001:.6f} {k} 0 -1.5 {TURNED}" for k in range(8)]
    (tmp_path / "poses.txt").write_text("# t tx ty tz qx qy qz qw\n\n" + "\r\n".join(lines))
    posed = Posed(dataset, tmp_path / "poses.txt", 0.02)
    poses = [frame.T_world_cam for frame in (posed[k] for k in range(N))]
    assert posed.n_poses == 3 and [T is None for T in poses] == [False] * 3 + [True] * 2
    for k, T in enumerate(poses[:3]):
        expected = [[0, -1, 0, 3 * k], [1, 0, 0, 0], [0, 0, 1, -1.5], [0, 0, 0, 1]]
        np.testing.assert_allclose(T, expected, atol=1e-7)
    late = Posed(Later(dataset, 2), tmp_path / "poses.txt", 0.02)
    assert late.n_poses == 1 and late[0].T_world_cam is not None


def test_a_pose_of_a_slower_clock_is_that_of_one_frame_only(dataset: Dataset, tmp_path: Path) -> None:
    lines = [f"{k / 20 + 0.002:.6f} {k} 0 -1.5 {TURNED}" for k in range(4)]
    (tmp_path / "poses.txt").write_text("\n".join(lines))
    posed = Posed(dataset, tmp_path / "poses.txt", 0.02)
    along_m = [None if (T := posed[k].T_world_cam) is None else T[0, 3] for k in range(N)]
    assert along_m == [0, None, 1, 2, 3] and posed.n_poses == 4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"expected lines of a time and tx ty tz .*poses\.txt, got none"),
        ("0 1 2 3\n", "expected a time and tx ty tz qx qy qz qw in line 1 of .*got '0 1 2 3'"),
        (f"\n0 1 2 north {TURNED}\n", "finite numbers tx ty tz .* line 2 of .*poses.txt, got 'north'"),
        (f"0 nan 2 3 {TURNED}\n", "finite numbers tx ty tz .* line 1 of .*poses.txt, got 'nan'"),
        (f"soon 1 2 3 {TURNED}\n", "expected a time in seconds at the start of line 1 of .*, got 'soon'"),
        ("0 1 2 3 0 0 0 0\n", "a quaternion .* of length 1 in line 1 of .*, got one of length 0"),
        ("0 1 2 3 10 20 30 40\n", "of length 54.8"),
        (f"0.1 1 2 3 {TURNED}\n0 1 2 3 {TURNED}\n", "that increase, got 0.0 s after 0.1 s"),
        (f"1699187734.5 1 2 3 {TURNED}\n", "within 20 ms of frames, whose times are 0.000 to .*are they by one clock"),
        (f"1.7e18 1 2 3 {TURNED}\n", "in seconds, .*are they in milliseconds"),
    ],
)
def test_a_trajectory_that_cannot_be_trusted_is_refused(
    text: str, message: str, dataset: Dataset, tmp_path: Path
) -> None:
    (tmp_path / "poses.txt").write_text(text)
    with pytest.raises(DatasetError, match=message):
        Posed(dataset, tmp_path / "poses.txt", 0.02)
