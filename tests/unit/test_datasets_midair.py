"""Mid-Air: float16 bits, rays and disparities become depth along the axis, and the sky becomes a hole."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from voxdepth.datasets import open_dataset
from voxdepth.datasets.midair import MidAirDataset
from voxdepth.errors import DatasetError
from voxdepth.tools.evaluation.references import TrueHoles, true_depths
from voxdepth.types import Intrinsics

SIDE = 16
TRAJECTORY = "trajectory_0003"


def write_float16(path: Path, values: object) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path.with_suffix(".png")), np.broadcast_to(np.float16(values), (SIDE, SIDE)).copy().view(np.uint16))
    path.with_suffix(".png").rename(path)


def write_colour(folder: Path, number: int, value: int = 90) -> None:
    path = folder / f"color_left/{TRAJECTORY}/{number:06d}.JPEG"
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".jpg", np.full((SIDE, SIDE, 3), value, np.uint8))
    assert done
    path.write_bytes(data.tobytes())


def depth_path(folder: Path, kind: str, number: int) -> Path:
    return folder / f"{kind}/{TRAJECTORY}/{number:06d}.PNG"


def test_disparity_becomes_depth_by_focal_length_and_a_baseline_of_a_metre(tmp_path: Path) -> None:
    disparity_px = np.random.default_rng(3).uniform(0.1, 40, (SIDE, SIDE)).astype(np.float16)
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "stereo_disparity", 0), disparity_px)
    dataset = open_dataset(tmp_path)
    assert isinstance(dataset, MidAirDataset)
    assert dataset.intrinsics == Intrinsics(
        fx_px=8, fy_px=8, cx_px=8, cy_px=8, width_px=SIDE, height_px=SIDE, baseline_m=1.0
    )
    frame = dataset[0]
    assert np.array_equal(frame.depth_m, np.float32(8) / disparity_px.astype(np.float32))
    assert abs(frame.gray.astype(int) - 90).max() <= 1 and frame.T_world_cam is None


def test_a_wall_across_the_axis_has_one_depth_though_its_ranges_differ(tmp_path: Path) -> None:
    row, col = np.mgrid[:SIDE, :SIDE]
    range_m = 5 * np.sqrt(((col - 8) / 8) ** 2 + ((row - 8) / 8) ** 2 + 1)
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), range_m)
    depth_m = open_dataset(tmp_path)[0].depth_m
    assert depth_m[8, 8] == 5
    assert np.allclose(depth_m, 5, rtol=2**-11)


def test_disparity_is_preferred_and_what_is_hidden_or_sky_is_a_hole(tmp_path: Path) -> None:
    disparity_px = np.full((SIDE, SIDE), 2.0)
    disparity_px[0], disparity_px[1] = 0, 0.005
    hidden = np.zeros((SIDE, SIDE), np.uint8)
    hidden[5, 6] = 255
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "stereo_disparity", 0), disparity_px)
    write_float16(depth_path(tmp_path, "depth", 0), 1.0)
    mask = tmp_path / f"stereo_occlusion/{TRAJECTORY}/000000.png"
    mask.parent.mkdir(parents=True)
    cv2.imwrite(str(mask), hidden)
    mask.rename(mask.with_suffix(".PNG"))
    expected = np.full((SIDE, SIDE), 4, np.float32)
    expected[:2], expected[5, 6] = 0, 0
    assert np.array_equal(open_dataset(tmp_path)[0].depth_m, expected)


@pytest.mark.parametrize("sky_m", [65504.0, np.inf, 60000.0])
def test_the_sky_of_a_range_image_is_a_hole(tmp_path: Path, sky_m: float) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), np.where(np.arange(SIDE) < 4, sky_m, 3.0))
    depth_m = open_dataset(tmp_path)[0].depth_m
    assert not depth_m[:, :4].any() and depth_m[:, 4:].all()


@pytest.mark.parametrize("kind", ["depth", "stereo_disparity"])
@pytest.mark.parametrize("value", [np.nan, -1.0, -np.inf])
def test_values_that_are_no_depth_are_refused(tmp_path: Path, kind: str, value: float) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, kind, 0), np.where(np.arange(SIDE) < 1, value, 3.0))
    with pytest.raises(DatasetError, match=rf"of at least 0 in .*{kind}.*000000\.PNG"):
        open_dataset(tmp_path)[0]


def test_frames_are_those_with_both_images_25_a_second(tmp_path: Path) -> None:
    for number in (0, 1, 2, 50):
        write_colour(tmp_path, number)
    for number in (1, 2, 3, 50):
        write_float16(depth_path(tmp_path, "depth", number), float(number))
    with pytest.warns(UserWarning, match="1 of 4 depth images have no gray image of their number"):
        dataset = open_dataset(tmp_path)
    assert [dataset.name(index) for index in range(len(dataset))] == ["000001", "000002", "000050"]
    assert [dataset[index].stamp_s for index in range(3)] == [0.04, 0.08, 2.0]
    assert [dataset[index].depth_m[8, 8] for index in range(3)] == [1, 2, 50]


def test_a_unit_is_not_stated_of_depth_that_has_its_own(tmp_path: Path) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), 3.0)
    with pytest.raises(DatasetError, match="a unit of its own: leave out units_per_m"):
        open_dataset(tmp_path, units_per_m=1000)


def test_given_intrinsics_count_for_rays_and_disparities(tmp_path: Path) -> None:
    camera = Intrinsics(fx_px=4, fy_px=8, cx_px=0, cy_px=0, width_px=SIDE, height_px=SIDE, baseline_m=0.5)
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "stereo_disparity", 0), 2.0)
    assert (open_dataset(tmp_path, intrinsics=camera)[0].depth_m == 1).all()
    depth_path(tmp_path, "stereo_disparity", 0).unlink()
    depth_path(tmp_path, "stereo_disparity", 0).parent.rmdir()
    write_float16(depth_path(tmp_path, "depth", 0), 5.0)
    depth_m = open_dataset(tmp_path, intrinsics=camera)[0].depth_m
    assert depth_m[0, 0] == 5 and np.isclose(depth_m[8, 4], 5 / np.sqrt(3))


def test_several_trajectories_are_listed_and_none_is_an_error(tmp_path: Path) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), 1.0)
    (tmp_path / "color_left/trajectory_0004").mkdir()
    with pytest.raises(DatasetError, match=r"exactly one trajectory in .*color_left, got trajectory_0003"):
        open_dataset(tmp_path)
    for path in (tmp_path / "color_left").iterdir():
        path.rename(tmp_path / path.name)
    (tmp_path / "depth").rename(tmp_path / "depths_of_another_name")
    with pytest.raises(DatasetError, match="midair lacks a folder trajectory_NNNN in color_left"):
        open_dataset(tmp_path)


def test_the_folders_of_another_camera_are_not_taken_for_those_of_a_trajectory(tmp_path: Path) -> None:
    for name in ("color_left", "depth"):
        (tmp_path / name).mkdir()
        cv2.imwrite(
            str(tmp_path / name / "000001.png"), np.full((SIDE, SIDE), 200, np.uint8 if name != "depth" else np.uint16)
        )
    camera = Intrinsics(fx_px=8, fy_px=8, cx_px=8, cy_px=8, width_px=SIDE, height_px=SIDE)
    assert open_dataset(tmp_path, intrinsics=camera).format == "realsense"


def test_disparity_is_measured_and_the_range_beside_it_is_the_truth(tmp_path: Path) -> None:
    write_colour(tmp_path, 7)
    write_float16(depth_path(tmp_path, "stereo_disparity", 7), np.where(np.arange(SIDE) < 4, 0.0, 2.0))
    row, col = np.mgrid[:SIDE, :SIDE]
    write_float16(depth_path(tmp_path, "depth", 7), 4 * np.sqrt(((col - 8) / 8) ** 2 + ((row - 8) / 8) ** 2 + 1))
    found = TrueHoles(tmp_path, dataset := open_dataset(tmp_path)).of(0, dataset[0].depth_m)
    assert np.array_equal(found.hidden, np.arange(SIDE)[None] < 4 + np.zeros((SIDE, 1)))
    assert np.allclose(found.reference_m, 4, rtol=2**-10)


def test_a_range_without_a_disparity_is_no_truth_of_itself(tmp_path: Path) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), 3.0)
    assert not true_depths(tmp_path).files


def test_images_without_a_common_number_are_refused(tmp_path: Path) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 1), 1.0)
    with pytest.raises(DatasetError, match="got none among 1 and 1"):
        open_dataset(tmp_path)


def test_an_image_that_is_not_square_is_not_of_this_dataset(tmp_path: Path) -> None:
    write_colour(tmp_path, 0)
    write_float16(depth_path(tmp_path, "depth", 0), 1.0)
    done, data = cv2.imencode(".jpg", np.zeros((SIDE, SIDE + 1, 3), np.uint8))
    (tmp_path / f"color_left/{TRAJECTORY}/000000.JPEG").write_bytes(data.tobytes())
    with pytest.raises(DatasetError, match=r"expected a square image .* got 17x16"):
        open_dataset(tmp_path)
    assert done
