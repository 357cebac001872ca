"""TUM RGB-D: values, times and pairs read back exactly, and every list that cannot be trusted is refused."""

import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.sequences import CAMERA, SHAPE, depth_of, write_images
from voxdepth.datasets import open_dataset
from voxdepth.datasets.pairs import associate
from voxdepth.datasets.tum import TumDataset
from voxdepth.errors import DatasetError

COLOUR_S = (1.00, 1.03, 1.06, 1.20)
DEPTH_S = (1.01, 1.05, 1.09, 1.21)
"""1.09 is 0.03 s from the nearest colour image."""


def colour_of(index: int) -> np.ndarray:
    return np.random.default_rng(index).integers(0, 256, (*SHAPE, 3), np.uint8)


def list_text(folder: str, stamps_s: Sequence[float]) -> str:
    return "# a comment\n\n" + "".join(f"{s:.6f} {folder}/{s:.6f}.png\n" for s in stamps_s)


pytestmark = [
    pytest.mark.filterwarnings("ignore:. of 4 depth images have no gray image"),
    pytest.mark.filterwarnings("ignore:.*(rgbd_dataset_freiburg1|fr1) is taken to have depth in steps of 1/5000 m"),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    tmp_path = tmp_path / "rgbd_dataset_freiburg1"
    tmp_path.mkdir()
    write_images(tmp_path, {f"rgb/{s:.6f}.png": colour_of(index) for index, s in enumerate(COLOUR_S)})
    write_images(tmp_path, {f"depth/{s:.6f}.png": depth_of(index) for index, s in enumerate(DEPTH_S)})
    (tmp_path / "rgb.txt").write_text(list_text("rgb", COLOUR_S))
    (tmp_path / "depth.txt").write_text(list_text("depth", DEPTH_S))
    (tmp_path / "groundtruth.txt").write_text("1.0 1 2 3 0 0 0 1\n")
    return tmp_path


def test_frames_have_the_nearest_colour_the_depth_in_metres_and_no_pose(folder: Path) -> None:
    with pytest.warns(UserWarning, match=r"1 of 4 depth images have no gray image within 20 ms"):
        dataset = open_dataset(folder, intrinsics=CAMERA)
    assert isinstance(dataset, TumDataset) and len(dataset) == 3 and dataset.intrinsics == CAMERA
    frames = [dataset[index] for index in range(3)]
    assert [frame.stamp_s for frame in frames] == [1.01, 1.05, 1.21]
    assert [dataset.name(index) for index in range(3)] == ["1.010000", "1.050000", "1.210000"]
    for frame, colour, depth in zip(frames, (0, 2, 3), (0, 1, 3), strict=True):
        assert np.array_equal(frame.gray, cv2.cvtColor(colour_of(colour), cv2.COLOR_BGR2GRAY))
        assert np.array_equal(frame.depth_m, depth_of(depth).astype(np.float32) / np.float32(5000))
        assert frame.T_world_cam is None
    assert dataset[-1].stamp_s == 1.21
    with pytest.raises(IndexError):
        dataset[3]


@pytest.mark.parametrize("start_s", [0, 1.7e9])
@pytest.mark.parametrize("per_s", [1e3, 1e6, 1e9])
def test_times_that_are_not_in_seconds_are_reported(per_s: float, start_s: float, folder: Path) -> None:
    for name, stamps_s in (("rgb", COLOUR_S), ("depth", DEPTH_S)):
        lines = (f"{(start_s + s) * per_s:.0f} {name}/{n:.6f}.png\n" for s, n in zip(DEPTH_S, stamps_s, strict=True))
        (folder / f"{name}.txt").write_text("".join(lines))
    reported = pytest.warns(UserWarning, match=r"\d s between two images of .*depth.txt: are the times in seconds")
    with pytest.raises(DatasetError, match="are they in milliseconds") if start_s else reported:
        open_dataset(folder, intrinsics=CAMERA)


def test_truth_is_not_even_opened(folder: Path) -> None:
    (folder / "groundtruth.txt").unlink()
    (folder / "groundtruth.txt").mkdir()
    assert open_dataset(folder, intrinsics=CAMERA)[0].T_world_cam is None


@pytest.mark.parametrize(
    ("name", "fx_px", "cy_px"),
    [
        ("rgbd_dataset_freiburg1_xyz", 517.3, 255.3),
        ("fr2_desk", 520.9, 249.7),
        ("rgbd_dataset_freiburg3_office", 535.4, 247.6),
        ("kitchen", 525.0, 239.5),
        ("afr1ca", 525.0, 239.5),
    ],
)
def test_the_published_camera_is_taken_by_the_folders_name(
    tmp_path: Path, name: str, fx_px: float, cy_px: float
) -> None:
    folder = tmp_path / name
    write_images(folder, {"depth.png": np.zeros((480, 640), np.uint16)})
    for kind in ("rgb", "depth"):
        (folder / f"{kind}.txt").write_text(f"1 {kind}.png\n")
    is_known = fx_px != 525.0
    with nullcontext() if is_known else pytest.warns(UserWarning, match=rf"{name} .* steps of 1/5000 m, .*units_per_m"):
        dataset = open_dataset(folder)
    camera = dataset.intrinsics
    assumed = next(dataset.assumed())
    assert ("focal length of 525 px" in assumed) is not is_known, "what the name does not tell is assumed, and said"
    assert ("has depth in steps of 1/5000 m, as TUM RGB-D has it" in assumed) is is_known
    assert (camera.fx_px, camera.cy_px, camera.shape, camera.baseline_m) == (fx_px, cy_px, (480, 640), None)
    if not is_known:
        with pytest.warns(UserWarning, match="units_per_m"):
            stated = open_dataset(folder, baseline_m=0.05)
        assert stated.intrinsics == replace(camera, baseline_m=0.05)
        assert list(stated.assumed()) == list(dataset.assumed()), "a baseline says nothing of the lens"


def test_images_of_another_size_need_a_calibration(folder: Path) -> None:
    with pytest.raises(DatasetError, match=r"are 8x6, and only .*640x480 is known; write .*calibration\.toml"):
        open_dataset(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.0 ../rgb/x.png\n", r"line 1 of .*rgb\.txt names '\.\./rgb/x\.png', which lies outside"),
        ("1.0 /etc/passwd\n", "lies outside"),
        ("1.0 C:\\x.png\n", "lies outside"),
        ("1.0 rgb/..\\..\\x.png\n", "lies outside"),
        ("1.0\n", r"expected a time and a file in line 1 of .*rgb\.txt"),
        ("1.0 a.png b\n", "expected a time and a file"),
        ("# x\nsoon a.png\n", r"expected a time in seconds at the start of line 2 of .*rgb\.txt, got 'soon'"),
        ("nan a.png\n", "expected a time"),
        ("1e999 a.png\n", "expected a time"),
        ("2.0 a.png\n1.0 b.png\n", r"expected times in .*rgb\.txt that increase, got 1\.0 s after 2\.0 s"),
        ("1.0 a.png\n1.0 b.png\n", "that increase"),
        ("\x80\x81\xff", r"a time and a file in line 1 of .*rgb\.txt, got .\\udc80"),
        ("1.0 a\0b.png\n", r"expected text in .*rgb\.txt"),
        ("", "got none among 4 and 0"),
        ("9.0 a.png\n", "within 20 ms of each other, got none among 4 and 1"),
    ],
)
def test_a_list_that_cannot_be_trusted_is_refused(folder: Path, text: str, message: str) -> None:
    (folder / "rgb.txt").write_bytes(text.encode("latin-1"))
    with pytest.raises(DatasetError, match=message):
        open_dataset(folder, intrinsics=CAMERA)


def test_a_listed_file_that_is_missing_stops_only_its_frame(folder: Path) -> None:
    (folder / "rgb/1.060000.png").unlink()
    dataset = open_dataset(folder, intrinsics=CAMERA)
    assert dataset[0].stamp_s == 1.01
    with pytest.raises(DatasetError, match=r"expected a file .*rgb/1\.060000\.png, got none"):
        dataset[1]


@pytest.mark.parametrize("name", ["rgb/1.060000.png", "depth/1.050000.png"])
def test_a_size_that_changes_within_the_stream_is_refused(folder: Path, name: str) -> None:
    kind = np.uint8 if name.startswith("rgb") else np.uint16
    cv2.imwrite(str(folder / name), np.zeros((6, 9), kind))
    with pytest.raises(DatasetError, match=rf"expected 8x6 pixels in .*{name}.* got 9x6"):
        open_dataset(folder, intrinsics=CAMERA)[1]


@pytest.mark.parametrize("linked", ["rgb", "depth", "rgb.txt", "rgb/1.000000.png"])
def test_links_to_another_place_are_followed(folder: Path, tmp_path: Path, linked: str) -> None:
    expected = [(frame.gray, frame.depth_m) for frame in open_dataset(folder, intrinsics=CAMERA)]
    (folder / linked).rename(tmp_path / "elsewhere")
    (folder / linked).symlink_to(tmp_path / "elsewhere")
    (tmp_path / "fr1").symlink_to(folder)
    for frame, (gray, depth_m) in zip(open_dataset(tmp_path / "fr1", intrinsics=CAMERA), expected, strict=True):
        assert np.array_equal(frame.gray, gray) and np.array_equal(frame.depth_m, depth_m)


@pytest.mark.parametrize(
    ("linked", "target"),
    [("rgb/1.000000.png", "/unmounted/1.png"), ("rgb/1.000000.png", "1.000000.png"), ("rgb", "/unmounted/rgb")],
)
def test_a_link_that_leads_nowhere_is_named(folder: Path, tmp_path: Path, linked: str, target: str) -> None:
    (folder / linked).rename(tmp_path / "elsewhere")
    (folder / linked).symlink_to(target)
    with pytest.raises(DatasetError, match=rf"{linked} is a link to {target}, which is not there"):
        open_dataset(folder, intrinsics=CAMERA)[0]


def write_millimetres(folder: Path, depth_mm: float) -> Path:
    """A TUM layout of two images by somebody whose camera has a depth in millimetres."""
    for k in range(2):
        write_images(folder, {f"rgb/{k}.png": colour_of(k), f"depth/{k}.png": np.full(SHAPE, depth_mm, np.uint16)})
    (folder / "rgb.txt").write_text("0 rgb/0.png\n1 rgb/1.png\n")
    (folder / "depth.txt").write_text("0 depth/0.png\n1 depth/1.png\n")
    return folder


def test_the_steps_of_the_benchmark_are_reported_where_they_are_assumed(tmp_path: Path) -> None:
    folder = write_millimetres(tmp_path / "mine", 3000)
    with pytest.warns(UserWarning, match=r"mine is taken to have depth in steps of 1/5000 m"):
        open_dataset(folder, intrinsics=CAMERA)
    assert np.allclose(open_dataset(folder, intrinsics=CAMERA, units_per_m=1000)[0].depth_m, 3)
    (folder / "calibration.toml").write_text("units_per_m = 1000\n")
    assert np.allclose(open_dataset(folder, intrinsics=CAMERA)[0].depth_m, 3)
    assert np.allclose(open_dataset(folder, intrinsics=CAMERA, units_per_m=5000)[0].depth_m, 0.6)


@pytest.mark.filterwarnings("ignore:.* steps of 1/5000 m")
@pytest.mark.parametrize("depth_mm", [300, 900, 1900])
def test_millimetres_that_would_be_nearer_than_a_kinect_sees_are_asked_about(tmp_path: Path, depth_mm: int) -> None:
    folder = write_millimetres(tmp_path / "mine", depth_mm)
    with pytest.raises(DatasetError, match=r"median depth of 0\.4 to 300 m, got .* state units_per_m"):
        open_dataset(folder, intrinsics=CAMERA)[0]
    assert np.allclose(open_dataset(folder, intrinsics=CAMERA, units_per_m=1000)[0].depth_m, depth_mm / 1000)


@pytest.mark.filterwarnings("default:.* steps of 1/5000 m")
@pytest.mark.parametrize("name", ["rgbd_dataset_freiburg1_mydesk", "fr2", "my_fr3_walk"])
@pytest.mark.parametrize("fx_px", [9.5, 4.0])
def test_the_name_of_the_benchmark_alone_makes_no_unit_certain(tmp_path: Path, name: str, fx_px: float) -> None:
    """The images of a D435 of 8 pixels have 1.5 m in millimetres; the benchmark's camera sees nothing at 0.3 m."""
    camera = replace(CAMERA, fx_px=fx_px)
    with pytest.warns(UserWarning, match=rf"{name} .* its camera is none of that: state units_per_m"):
        dataset = open_dataset(write_millimetres(tmp_path / name, 1500), intrinsics=camera)
    with pytest.raises(DatasetError, match=r"median depth of 0\.4 to 300 m, got 0\.3 m"):
        dataset[0]
    published = replace(CAMERA, fx_px=6.5)
    assert "1/5000 m" in next(open_dataset(write_millimetres(tmp_path / name, 5000), intrinsics=published).assumed())


def test_frames_without_a_partner_are_reported_and_the_tolerance_can_be_stated(folder: Path) -> None:
    with pytest.warns(UserWarning, match="1 of 4 depth images have no gray image within 15 ms"):
        open_dataset(folder, intrinsics=CAMERA, within_s=0.015)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", "depth images")
        assert len(open_dataset(folder, intrinsics=CAMERA, within_s=0.11)) == 4


TIMES = st.lists(st.integers(0, 60), unique=True, max_size=12).map(sorted)


@given(TIMES, TIMES, st.integers(0, 8))
def test_matches_are_near_used_once_and_none_is_left_that_could_be_made(
    first: list[int], second: list[int], within: int
) -> None:
    pairs = associate(first, second, within_s=within)
    used_first, used_second = [i for i, _ in pairs], [j for _, j in pairs]
    assert used_first == sorted(set(used_first)) and len(set(used_second)) == len(used_second)
    assert all(abs(first[i] - second[j]) <= within for i, j in pairs)
    left = [s for i, s in enumerate(first) if i not in used_first]
    assert not any(abs(a - b) <= within for a in left for j, b in enumerate(second) if j not in used_second)
    closest = min((abs(a - b) for a in first for b in second), default=within + 1)
    assert closest > within or closest in [abs(first[i] - second[j]) for i, j in pairs]


@given(TIMES)
def test_a_stream_is_matched_with_itself_frame_by_frame(stamps: list[int]) -> None:
    assert associate(stamps, stamps, within_s=5) == [(i, i) for i in range(len(stamps))]


def test_times_that_are_none_of_a_camera_are_refused_before_they_take_long() -> None:
    stamps = [k * 1e-9 for k in range(100_000)]
    with pytest.raises(DatasetError, match=r"at most 1000 images within 0.02 s of another one, got 100000"):
        associate(stamps, stamps, within_s=0.02)
