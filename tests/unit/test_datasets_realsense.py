"""RealSense exports: scale, camera and times come from where a tool put them, and only aligned images are read."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.sequences import CAMERA, SHAPE, depth_of, gray_of, write_images
from voxdepth.datasets import open_dataset
from voxdepth.datasets.realsense import RealSenseDataset
from voxdepth.errors import DatasetError

OPEN3D = {"width": 8, "height": 6, "intrinsic_matrix": [9.5, 0, 0, 0, 9.25, 0, 3.5, 2.5, 1]}


def write(folder: Path, depth: list[str], gray: list[str], gray_folder: str = "color", **metadata: Any) -> None:
    for name in ("depth", gray_folder):
        (folder / name).mkdir()
    write_images(folder, {f"depth/{stem}.png": depth_of(index) for index, stem in enumerate(depth)})
    write_images(folder, {f"{gray_folder}/{stem}.png": gray_of(index) for index, stem in enumerate(gray)})
    (folder / "camera_intrinsic.json").write_text(json.dumps({**OPEN3D, **metadata}))


def stamps(folder: Path) -> list[float]:
    dataset = open_dataset(folder)
    return [dataset[index].stamp_s for index in range(len(dataset))]


@pytest.mark.parametrize("gray_folder", ["color", "rgb", "infra1", "ir"])
def test_an_open3d_recording_reads_back_exactly(tmp_path: Path, gray_folder: str) -> None:
    write(tmp_path, ["000000", "000001"], ["000000", "000001"], gray_folder)
    (tmp_path / "depth" / "._000000.png").touch()  # What macOS leaves on other disks is no image.
    dataset = open_dataset(tmp_path)
    assert isinstance(dataset, RealSenseDataset) and dataset.intrinsics == CAMERA and len(dataset) == 2
    for index in range(2):
        frame = dataset[index]
        assert np.array_equal(frame.gray, gray_of(index)) and frame.T_world_cam is None
        assert np.array_equal(frame.depth_m, (depth_of(index) / 1000).astype(np.float32))
    assert [dataset.name(0), dataset.name(1)] == ["000000", "000001"]


@pytest.mark.parametrize(("scale", "metres"), [(1000, 65.534), (0.001, 65.534), (10000.0, 6.5534), (0.0001, 6.5534)])
def test_the_depth_scale_is_taken_from_the_metadata(tmp_path: Path, scale: float, metres: float) -> None:
    write(tmp_path, ["0"], ["0"], depth_scale=scale)
    write_images(tmp_path, {"depth/0.png": np.full(SHAPE, 65534, np.uint16)})
    assert np.allclose(open_dataset(tmp_path)[0].depth_m, metres, rtol=1e-6)


@pytest.mark.parametrize(
    ("names", "metadata", "expected"),
    [
        (["000000", "000001", "000003"], {}, [0, 1 / 30, 3 / 30]),
        (["000000", "000001", "000003"], {"fps": 10}, [0, 0.1, 0.3]),
        (["1", "2", "10"], {}, [1 / 30, 2 / 30, 10 / 30]),
        (["frame_1", "frame_2"], {}, [1 / 30, 2 / 30]),
        (["1545304876500000000", "1545304876600000000"], {}, [1545304876.5, 1545304876.6]),
    ],
)
def test_times_are_those_of_the_file_names(
    tmp_path: Path, names: list[str], metadata: dict[str, Any], expected: list[float]
) -> None:
    write(tmp_path, names, names, **metadata)
    assert stamps(tmp_path) == pytest.approx(expected, abs=1e-6)
    dataset = open_dataset(tmp_path)
    given = [dataset.name(index) for index in range(len(dataset))]
    assert given == sorted(set(given))


@pytest.mark.parametrize(
    ("suffix", "stored"),
    [
        (".npy", depth_of(0)),
        (".npy", depth_of(0).astype(">u2")),
        (".npy", (depth_of(0) / 1000).astype(">f4")),
        (".npy", (depth_of(0) / 1000).astype(np.float16)),
        (".tiff", (depth_of(0) / 1000).astype(np.float32)),
        (".tif", depth_of(0)),
    ],
)
def test_depth_in_other_files_than_png_has_the_usual_unit_of_its_type(
    tmp_path: Path, suffix: str, stored: np.ndarray
) -> None:
    write(tmp_path, [], ["7"])
    write_images(tmp_path, {f"depth/7{suffix}": stored})
    assert np.allclose(open_dataset(tmp_path)[0].depth_m, depth_of(0) / 1000, rtol=1e-3)


@pytest.mark.parametrize(
    ("depth", "gray", "left_out", "kept"),
    [
        ("02", "012", r"1 of 5 images are left out, .*: the first is .*color/1\.png", [0, 2 / 30]),
        ("0123", "012", r"1 of 7 images are left out, .*: the first is .*depth/3\.png", [0, 1 / 30, 2 / 30]),
        ("123", "01", r"3 of 5 images are left out, .*: the first is .*color/0\.png", [1 / 30]),
    ],
)
def test_images_without_a_partner_are_left_out_and_reported(
    tmp_path: Path, depth: str, gray: str, left_out: str, kept: list[float]
) -> None:
    write(tmp_path, list(depth), list(gray))
    with pytest.warns(UserWarning, match=left_out):
        dataset = open_dataset(tmp_path)
    assert [dataset[index].stamp_s for index in range(len(dataset))] == pytest.approx(kept)
    assert np.array_equal(dataset[0].gray, gray_of(gray.index(dataset.name(0))))


@pytest.mark.parametrize(
    ("depth", "gray"), [("depths", "images"), ("Depth", "RGB"), ("depth_left", "image_left"), ("depth", "gray")]
)
def test_similar_names_of_the_folders_are_known(tmp_path: Path, depth: str, gray: str) -> None:
    write_images(
        tmp_path, {f"{depth}/000000_left_depth.npy": np.full(SHAPE, 2, np.float32), f"{gray}/0.png": gray_of(0)}
    )
    (tmp_path / "camera_intrinsic.json").write_text(json.dumps(OPEN3D))
    np.testing.assert_array_equal(open_dataset(tmp_path)[0].depth_m, 2)


@pytest.mark.parametrize(
    ("in_depth", "in_color", "message"),
    [
        ("0.jpg", "0.png", r"depth/0\.jpg is a JPEG, which holds no depth.*exchange the names of the two folders"),
        ("0.jpeg", "0.tiff", r"depth/0\.jpeg is a JPEG"),
        ("0.png", "0.png", r"color/0\.png has 16 bits, .*exchange the names of the folders color and depth"),
    ],
)
def test_folders_that_are_swapped_are_reported(tmp_path: Path, in_depth: str, in_color: str, message: str) -> None:
    write_images(tmp_path, {f"depth/{in_depth}": gray_of(0), f"color/{in_color}": depth_of(0)})
    with pytest.raises(DatasetError, match=message):
        open_dataset(tmp_path, intrinsics=CAMERA)


def test_floats_in_the_channels_of_a_png_are_metres_and_a_picture_is_none(tmp_path: Path) -> None:
    """As TartanAir V2 stores depth."""
    write(tmp_path, [], ["0"])
    depth_m = np.geomspace(0.4, 9000, 48, dtype=np.float32).reshape(SHAPE)
    write_images(tmp_path, {"depth/0.png": depth_m.view(np.uint8).reshape(*SHAPE, 4)})
    np.testing.assert_array_equal(open_dataset(tmp_path)[0].depth_m, depth_m)
    assert "has depth in metres" in next(open_dataset(tmp_path).assumed())
    for alpha in (255, 128, 90):
        picture = np.dstack([gray_of(0), gray_of(1), gray_of(2), np.full(SHAPE, alpha, np.uint8)])
        write_images(tmp_path, {"depth/0.png": picture})
        with pytest.raises(DatasetError, match="a picture in colours"):
            open_dataset(tmp_path)[0]


def test_depth_beside_previews_of_it_is_found(tmp_path: Path) -> None:
    write(tmp_path, ["0"], ["0"])
    write_images(tmp_path, {"depth/0.png": np.dstack([gray_of(0)] * 3)})
    np.save(tmp_path / "depth" / "0.NPY.npy", depth_of(0))
    (tmp_path / "depth" / "0.NPY.npy").rename(tmp_path / "depth" / "0.NPY")
    np.testing.assert_array_equal(open_dataset(tmp_path)[0].depth_m, (depth_of(0) / 1000).astype(np.float32))


def test_of_several_folders_of_images_the_one_that_is_taken_is_named(tmp_path: Path) -> None:
    write(tmp_path, ["0"], ["0"])
    write_images(tmp_path, {"infra1/0.png": gray_of(5), "left/0.png": gray_of(6)})
    with pytest.warns(UserWarning, match=r"/color is taken for the images in whose view .*, and not infra1, left"):
        dataset = open_dataset(tmp_path)
    np.testing.assert_array_equal(dataset[0].gray, gray_of(0))


def test_images_that_are_not_aligned_are_refused(tmp_path: Path) -> None:
    write(tmp_path, ["0"], ["0"])
    write_images(tmp_path, {"depth/0.png": np.zeros((12, 16), np.uint16)})
    with pytest.raises(DatasetError, match=r"depth/0\.png is 16x12 and .*color/0\.png is 8x6; align"):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("depth", "gray", "message"),
    [
        (["0"], ["1"], "got none among 1 and 1"),
        ([], [], "got none among 0 and 0"),
        (["100.0"], ["200.0"], "got none among 1 and 1"),
        (["1"], ["1699187734.5"], "same numbers or times .* got none among 1 and 1"),
        (["a1", "b1"], ["1"], r"got a1\.png and b1\.png .*each camera into a folder"),
    ],
)
def test_images_that_cannot_be_matched_are_refused(
    tmp_path: Path, depth: list[str], gray: list[str], message: str
) -> None:
    write(tmp_path, depth, gray)
    with pytest.raises(DatasetError, match=message):
        open_dataset(tmp_path)


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"intrinsic_matrix": [9, 0, 4, 0, 9, 3, 0, 0, 1]}, "by columns"),
        ({"intrinsic_matrix": [9, 0, 0, 0.1, 9, 0, 4, 3, 1]}, "by columns"),
        ({"intrinsic_matrix": [[9, 0, 4], [0, 9, 3], [0, 0, 1]]}, "of 9 numbers"),
        ({"intrinsic_matrix": None}, "of 9 numbers"),
        ({"intrinsic_matrix": [10**400, 0, 0, 0, 9, 0, 4, 3, 1]}, "too large"),
        ({"height": None}, "height_px must be a whole number"),
        ({"depth_scale": 0}, "positive number for depth_scale"),
        ({"depth_scale": float("nan")}, "positive number for depth_scale"),
        ({"depth_scale": True}, "positive number for depth_scale"),
        ({"fps": "fast"}, "positive number for fps"),
    ],
)
def test_metadata_that_make_no_sense_are_refused(tmp_path: Path, metadata: dict[str, Any], message: str) -> None:
    write(tmp_path, ["0"], ["0"], **metadata)
    with pytest.raises(DatasetError, match=message) as caught:
        open_dataset(tmp_path)
    assert "camera_intrinsic.json" in str(caught.value) or "calibration of" in str(caught.value)


@pytest.mark.parametrize(("data", "message"), [(b"{", "no JSON"), (b"[]", "a JSON object"), (b"\xff", "expected text")])
def test_metadata_that_are_no_json_object_are_refused(tmp_path: Path, data: bytes, message: str) -> None:
    write(tmp_path, ["0"], ["0"])
    (tmp_path / "camera_intrinsic.json").write_bytes(data)
    with pytest.raises(DatasetError, match=message):
        open_dataset(tmp_path)


def test_without_metadata_a_calibration_is_requested(tmp_path: Path) -> None:
    write(tmp_path, ["0"], ["0"])
    (tmp_path / "camera_intrinsic.json").unlink()
    keys = "fx_px, fy_px, cx_px, cy_px, width_px, height_px"
    with pytest.raises(DatasetError, match=rf"the camera in calibration\.toml or .*; write .* with {keys}") as reported:
        open_dataset(tmp_path)
    assert "width_px = 8  # width of the images [px]" in reported.value.__notes__
    assert len(open_dataset(tmp_path, intrinsics=CAMERA)) == 1


@pytest.mark.parametrize("name", ["rgb.txt", "depth.txt", "associations.txt"])
def test_a_damaged_tum_folder_is_not_taken_for_one_of_other_units(tmp_path: Path, name: str) -> None:
    write(tmp_path, ["0"], ["0"], "rgb")
    (tmp_path / name).write_text("0.0 depth/0.png\n")
    with pytest.raises(DatasetError, match="TUM RGB-D, whose depth has other units"):
        open_dataset(tmp_path)
