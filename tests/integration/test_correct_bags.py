"""`voxdepth correct` and `voxdepth evaluate` with bags: what is written, and that it is whole or absent."""

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from sim.testing import noisy_sequence
from tests.bags import S, camera_info, image, images, write_bag
from tests.commands import invoke
from tests.sequences import toml_of, write_images
from voxdepth.datasets import open_dataset
from voxdepth.errors import DatasetError
from voxdepth.registry import create_corrector
from voxdepth.ros import depth_of, gray_of, header_of
from voxdepth.tools.errors import ToolError
from voxdepth.types import Intrinsics

N_FRAMES = 6
START_NS = 1_700_000_000 * S + 987_654_321
STAMPS_NS = [START_NS + index * S // 30 for index in range(N_FRAMES)]
KINDS = {"/voxdepth/gray", "/voxdepth/depth", "/voxdepth/source", "/voxdepth/confidence", "/voxdepth/camera_info"}


@pytest.fixture(scope="module")
def entries() -> dict[str, list]:
    """The topics of a short flight of the simulator."""
    captures = list(noisy_sequence("flicker", "medium", frames=N_FRAMES))
    headers = [(stamp, "left_optical") for stamp in STAMPS_NS]
    mm = [np.minimum(capture.depth_raw_m * 1000, 65535).astype(np.uint16) for capture in captures]
    camera = captures[0].intrinsics
    infos = [[camera_info(camera, h, baseline_m=baseline) for h in headers] for baseline in (0, camera.baseline_m or 0)]
    gray = [image(capture.gray_left, "mono8", h) for capture, h in zip(captures, headers, strict=True)]
    return {
        "depth": images("/cam/depth", [image(d, "16UC1", h) for d, h in zip(mm, headers, strict=True)]),
        "gray": images("/cam/image", gray),
        "info": images("/cam/camera_info", infos[0], "CameraInfo"),
        "right": images("/right/camera_info", infos[1], "CameraInfo"),
    }


@pytest.fixture(scope="module")
def bag(entries: dict[str, list], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of all topics. Read only."""
    return write_bag(tmp_path_factory.mktemp("bag") / "walk.bag", [*chain(*entries.values())])


def messages(path: Path) -> Iterator[tuple[str, int, Any]]:
    with AnyReader([path]) as reader:
        for connection, received_ns, data in reader.messages():
            yield connection.topic, received_ns, reader.deserialize(data, connection.msgtype)


def test_a_bag_has_the_correction_of_every_frame_with_its_own_header(bag: Path, tmp_path: Path) -> None:
    done = invoke("correct", bag, "--out", tmp_path / "out.mcap")
    assert done.exit_code == 0, done.output
    assert [path.name for path in tmp_path.iterdir()] == ["out.mcap"]
    dataset = open_dataset(bag)
    assert dataset.intrinsics.baseline_m is not None
    corrector = create_corrector("temporal", dataset.intrinsics)
    written = list(messages(tmp_path / "out.mcap"))
    for index, stamp_ns in enumerate(STAMPS_NS):
        found = {topic: message for topic, received_ns, message in written if received_ns == stamp_ns}
        assert found.keys() == KINDS
        assert {header_of(message) for message in found.values()} == {(stamp_ns, "left_optical")}
        expected = corrector.process(dataset[index])
        np.testing.assert_array_equal(depth_of(found["/voxdepth/depth"]), expected.depth_m)
        np.testing.assert_array_equal(gray_of(found["/voxdepth/source"]), expected.source)
        np.testing.assert_allclose(gray_of(found["/voxdepth/confidence"]) / 255, expected.confidence, atol=0.002)
        lens = Intrinsics.from_camera_info(found["/voxdepth/camera_info"], baseline_m=dataset.intrinsics.baseline_m)
        assert lens == dataset.intrinsics
        np.testing.assert_array_equal(gray_of(found["/voxdepth/gray"]), dataset[index].gray)
    assert len(written) == 5 * N_FRAMES
    content = (tmp_path / "out.mcap").read_bytes()
    for of_metadata in (b"config.toml", b"report.json", b"pixel_shares"):
        assert of_metadata in content


def test_a_bag_of_ours_is_read_again(bag: Path, tmp_path: Path) -> None:
    assert invoke("correct", bag, "--out", tmp_path / "once.mcap", "--corrector", "raw").exit_code == 0
    dataset, again = open_dataset(bag), open_dataset(tmp_path / "once.mcap")
    assert len(again) == len(dataset)
    for index in range(N_FRAMES):
        np.testing.assert_array_equal(again[index].gray, dataset[index].gray)
        np.testing.assert_array_equal(again[index].depth_m, dataset[index].depth_m)
        assert again.header(index) == dataset.header(index)


def test_the_result_of_a_file_is_a_folder_unless_a_file_is_named(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert invoke("correct", bag, "--frames", "1").exit_code == 0
    assert sorted(path.name for path in (tmp_path / "corrected" / bag.stem / "depth").iterdir()) == ["000000.png"]


def test_a_folder_is_not_taken_for_a_file(bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.mcap"
    out.mkdir()
    assert "out.mcap exists already" in str(invoke("correct", bag, "--out", out).exception)


def test_times_that_ros_does_not_have_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    folder, lens = tmp_path / "walk", Intrinsics.from_hfov(width_px=64, height_px=48, hfov_deg=80, baseline_m=0.05)
    for kind, pixels in (("rgb", np.full(lens.shape, 90, np.uint8)), ("depth", np.full(lens.shape, 900, np.uint16))):
        write_images(folder, {f"{kind}/0.png": pixels})
        (folder / f"{kind}.txt").write_text(f"-0.001 {kind}/0.png\n")
    (folder / "calibration.toml").write_text(f"{toml_of(lens)}units_per_m = 1000\n")
    done = invoke("correct", folder, "--out", tmp_path / "out.mcap")
    assert isinstance(done.exception, ToolError)
    assert "expected times of 0 to 2147483648 s for a bag of ROS 2, got -0.001 s of frame 0" in str(done.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["walk"]


def test_the_largest_difference_of_a_pair_is_an_option(bag: Path, tmp_path: Path) -> None:
    assert invoke("correct", bag, "--out", tmp_path / "out", "--frames", "1", "--within", "0").exit_code == 0
    assert invoke("correct", bag, "--out", tmp_path / "none", "--within", "-1").exit_code == 2


def test_another_format_becomes_a_bag_with_its_times(bag: Path, tmp_path: Path) -> None:
    dataset = open_dataset(bag)
    for index in range(2):
        frame, name = dataset[index], f"{STAMPS_NS[index] // 1000}.png"
        depth_mm = (frame.depth_m * 1000).astype(np.uint16)
        write_images(tmp_path / "export", {f"depth/{name}": depth_mm, f"ir/{name}": frame.gray})
    (tmp_path / "export" / "calibration.toml").write_text(toml_of(dataset.intrinsics))
    done = invoke("correct", tmp_path / "export", "--out", tmp_path / "out.mcap")
    assert done.exit_code == 0
    reported = r"export has depth in millimetres, as most cameras have it, [\d.]+ m in the median of its first image"
    assert re.search(reported, done.output)
    headers = {header_of(message) for _, _, message in messages(tmp_path / "out.mcap")}
    assert {header.frame_id for header in headers} == {"camera"}
    for stamp_ns, header in zip(STAMPS_NS, sorted(headers), strict=False):
        assert abs(header.stamp_ns - stamp_ns) < 2000  # The names have microseconds.


def test_a_bag_that_cannot_be_corrected_gives_one_line_and_no_file(entries: dict[str, list], tmp_path: Path) -> None:
    path = write_bag(tmp_path / "walk.mcap", entries["gray"] + entries["info"])
    for out in ("out.mcap", "out"):
        done = invoke("correct", path, "--out", tmp_path / out)
        assert isinstance(done.exception, DatasetError)
        assert "expected images of depth" in str(done.exception)
        assert "\n" not in str(done.exception)
        assert [file.name for file in tmp_path.iterdir()] == ["walk.mcap"]


def test_a_bag_that_is_interrupted_or_exists_leaves_nothing_and_replaces_nothing(
    bag: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(fields: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("voxdepth.tools.output.confidence_fields", stop)
        assert invoke("correct", bag, "--out", tmp_path / "out.mcap").exit_code != 0
    assert not list(tmp_path.iterdir())
    (tmp_path / "out.mcap").write_text("mine")
    assert isinstance(invoke("correct", bag, "--out", tmp_path / "out.mcap").exception, ToolError)
    assert (tmp_path / "out.mcap").read_text() == "mine"


@pytest.mark.slow
def test_a_bag_is_evaluated_like_any_other_recording(entries: dict[str, list], bag: Path, tmp_path: Path) -> None:
    second = [entry._replace(topic="/two") for entry in entries["depth"]]
    path = write_bag(tmp_path / "walk.mcap", [*chain(*entries.values()), *second])
    command = ("evaluate", "--methods", "raw", "--frames", "2", "--out", tmp_path / "results", "--data", path)
    done = invoke(*command, "--depth-topic", "/two")
    assert done.exit_code == 0, done.output
    table = (tmp_path / "results" / "results.csv").read_text()
    assert "walk.mcap-shadows" in table
    assert ",close," in table
    failed = invoke(*command)
    assert "choose one with --depth-topic" in " ".join(failed.output.split()) + str(failed.exception)
