"""Bags: the same frames from every kind of file, the topics of one camera, and what is refused."""

import os
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bags import FLOAT32, Entry, S, camera_info, compressed, image, images, in_order, write_bag
from tests.realsense_files import record_with_librealsense
from tests.sequences import CAMERA, depth_of, encoded, gray_of, toml_of, write_images
from voxdepth.datasets import Dataset, open_dataset
from voxdepth.datasets.bags import Bag
from voxdepth.errors import ConfigError, DatasetError
from voxdepth.types import Intrinsics

OTHER = replace(CAMERA, fx_px=12.0, fy_px=12.0)
N_FRAMES = 5
START_NS = 1_700_000_000 * S + 123_456_789
STAMPS_NS = [START_NS + index * S // 30 for index in range(N_FRAMES)]
LAYOUTS = ("walk.bag", "walk.db3", "walk.mcap", "walk-sqlite3", "walk-mcap")
CALIBRATION = toml_of(replace(CAMERA, baseline_m=0.07))
DEPTH, GRAY = "/cam/depth/image_rect", "/cam/left/image_rect"


def depth_topic(topic: str = DEPTH, frame_id: str = "left", stamps_ns: list[int] = STAMPS_NS) -> list[Entry]:
    return images(topic, [image(depth_of(i), "16UC1", (t, frame_id), padding=4) for i, t in enumerate(stamps_ns)])


def gray_topic(topic: str = GRAY, frame_id: str = "left", stamps_ns: list[int] = STAMPS_NS) -> list[Entry]:
    return images(topic, [image(gray_of(i), "mono8", (t, frame_id)) for i, t in enumerate(stamps_ns)])


def compressed_topic(topic: str, format: str, contents: list[bytes]) -> list[Entry]:
    made = [compressed(data, format, (t, "left")) for data, t in zip(contents, STAMPS_NS, strict=True)]
    return images(topic, made, "CompressedImage")


def compressed_depth() -> list[Entry]:
    contents = [bytes(12) + encoded(depth_of(index)) for index in range(N_FRAMES)]
    return compressed_topic(f"{DEPTH}/compressedDepth", "16UC1; compressedDepth png", contents)


def compressed_gray(topic: str = f"{GRAY}/compressed") -> list[Entry]:
    return compressed_topic(topic, "mono8; png compressed ", [encoded(gray_of(index)) for index in range(N_FRAMES)])


def info_topic(topic: str, camera: Intrinsics = CAMERA, frame_id: str = "left", **options: Any) -> list[Entry]:
    return images(topic, [camera_info(camera, (t, frame_id), **options) for t in STAMPS_NS], "CameraInfo")


def whole() -> list[Entry]:
    """A left camera with depth."""
    return depth_topic() + gray_topic() + info_topic("/cam/depth/camera_info") + info_topic("/cam/left/camera_info")


def changed(entries: list[Entry], **fields: Any) -> list[Entry]:
    """The messages of a topic with other fields."""
    return [entry._replace(fields=entry.fields | fields) for entry in entries]


def write(folder: Path, layout: str, entries: list[Entry]) -> Path:
    return write_bag(folder / layout, in_order(entries))


def opened(folder: Path, entries: list[Entry], **options: Any) -> Dataset:
    return open_dataset(write(folder, "walk.mcap", entries), **options)


def require_images(dataset: Dataset, indices: list[int]) -> None:
    """Check that frames hold the images of their numbers."""
    for index in indices:
        frame = dataset[index]
        np.testing.assert_array_equal(frame.depth_m, depth_of(index) / np.float32(1000))
        np.testing.assert_array_equal(frame.gray, gray_of(index))
        assert frame.gray.flags.writeable and frame.depth_m.flags.c_contiguous


def require_frames(dataset: Dataset, indices: range | list[int] = range(N_FRAMES)) -> None:
    """Check the headers, too."""
    require_images(dataset, list(indices))
    for index in indices:
        assert dataset.header(index) == (STAMPS_NS[index], "left")
        assert dataset[index].stamp_s == pytest.approx(STAMPS_NS[index] / 1e9, abs=1e-6)


def require_camera(dataset: Dataset, camera: Intrinsics, baseline_m: float) -> None:
    assert replace(dataset.intrinsics, baseline_m=None) == camera
    assert dataset.intrinsics.baseline_m == pytest.approx(baseline_m)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_kind_of_bag_gives_the_same_frames_in_any_order(layout: str, tmp_path: Path) -> None:
    dataset = open_dataset(write(tmp_path, layout, whole()))
    assert (dataset.format, len(dataset), dataset.intrinsics) == ("bag", N_FRAMES, CAMERA)
    assert [dataset.name(index) for index in (0, 4)] == ["000000", "000004"]
    require_frames(dataset)
    require_frames(dataset, [3, 1, 4, 4, 0, 2])
    np.testing.assert_array_equal(dataset[-1].gray, gray_of(4))
    with pytest.raises(IndexError):
        dataset[N_FRAMES]


@pytest.mark.parametrize("layout", ["walk.bag", "walk.mcap", "walk.db3"])
def test_a_folder_with_one_bag_is_that_bag_and_one_with_two_is_not(layout: str, tmp_path: Path) -> None:
    path = write(tmp_path, layout, whole())
    require_frames(open_dataset(tmp_path), [0])
    path.with_name(f"copy{path.suffix}").write_bytes(path.read_bytes())
    with pytest.raises(DatasetError, match=r"bag lacks one file \.bag or \.db3 or \.mcap"):
        open_dataset(tmp_path)


def received_at(times_ns: list[int], *topics: list[Entry]) -> list[Entry]:
    """The messages of topics in turn, of which those of one number were received at one time."""
    rows = zip(times_ns, *topics, strict=True)
    return [entry._replace(received_ns=time_ns) for time_ns, *entries in rows for entry in entries]


def test_messages_of_one_time_are_distinguished(tmp_path: Path) -> None:
    at_once = received_at([START_NS + S] * N_FRAMES, depth_topic(), gray_topic())
    require_frames(opened(tmp_path, at_once + info_topic("/camera_info")), [2, 0, 4, 1])


def test_images_are_matched_by_the_nearest_stamp_within_20_ms(tmp_path: Path) -> None:
    late_ns = [stamp + S // 100 for stamp in STAMPS_NS]
    late_ns[2] += S // 60  # 27 ms after its depth, and 6 ms before the next, which has a nearer one or none
    gray = gray_topic(stamps_ns=late_ns)
    del gray[3]
    text = "1 of 5 depth images have no gray image within 20 ms and are left out: .*5 images, 30 a.*4 images, 22.5 a"
    with pytest.warns(UserWarning, match=text):
        dataset = opened(tmp_path, depth_topic() + gray + info_topic("/camera_info"))
    assert [dataset.header(index).stamp_ns for index in range(len(dataset))] == [STAMPS_NS[i] for i in (0, 1, 3, 4)]
    np.testing.assert_array_equal(dataset[2].gray, gray_of(2))
    np.testing.assert_array_equal(dataset[3].gray, gray_of(4))


def restamped(entries: list[Entry], stamps_ns: list[int]) -> list[Entry]:
    """The messages of a topic with other stamps."""
    pairs = zip(entries, stamps_ns, strict=True)
    return [entry._replace(fields=entry.fields | {"header": (stamp_ns, "left")}) for entry, stamp_ns in pairs]


def require_recorded_order(dataset: Dataset) -> None:
    assert len(dataset) == N_FRAMES
    require_images(dataset, [0, 1, 2, 3, 4, 1, 4, 0])


BACK_NS = [*STAMPS_NS[:3], *(stamp - 5 * S // 60 for stamp in STAMPS_NS[3:])]
"""A clock is set back by 83 ms before the fourth image."""


@pytest.mark.parametrize("layout", ["walk.bag", "walk-mcap"])
@pytest.mark.parametrize(
    ("stamps_ns", "where"),
    [
        (BACK_NS, r"got 1700000000.140123 s of message 3 after 1700000000.190124 s of message 2"),
        (STAMPS_NS[:1] * N_FRAMES, "of message 1 after 1700000000.123457 s of message 0"),
    ],
    ids=["set back", "all alike"],
)
def test_stamps_that_do_not_increase_give_way_to_the_times_of_reception(
    layout: str, stamps_ns: list[int], where: str, tmp_path: Path
) -> None:
    for number, (depth, gray) in enumerate(((stamps_ns, stamps_ns), (stamps_ns, STAMPS_NS), (STAMPS_NS, stamps_ns))):
        entries = restamped(depth_topic(), depth) + restamped(gray_topic(), gray) + info_topic("/camera_info")
        (tmp_path / f"{number}").mkdir()
        with pytest.warns(UserWarning, match=f"{where}.*the times at which the images were received count"):
            dataset = open_dataset(write(tmp_path / f"{number}", layout, entries))
        require_recorded_order(dataset)
        assert dataset.header(2).stamp_ns == pytest.approx(STAMPS_NS[2] + S // 200, abs=1000), "ROS 1 has microseconds"


@pytest.mark.parametrize("layout", ["walk.bag", "walk.db3", "walk-mcap"])
def test_a_clock_of_the_recorder_that_is_set_back_changes_neither_order_nor_stamps(layout: str, tmp_path: Path) -> None:
    entries = received_at(BACK_NS, depth_topic(), gray_topic(), info_topic("/camera_info"))
    dataset = open_dataset(write_bag(tmp_path / layout, entries))
    require_recorded_order(dataset)
    require_frames(dataset)


@pytest.mark.parametrize("layout", ["walk.bag", "walk-mcap"])
def test_a_bag_without_any_times_that_increase_is_refused_with_both_places(layout: str, tmp_path: Path) -> None:
    topics = [restamped(topic, [START_NS] * N_FRAMES) for topic in (depth_topic(), gray_topic())]
    entries = received_at(BACK_NS, *topics)
    path = write_bag(tmp_path / layout, entries + info_topic("/camera_info"))
    with pytest.raises(DatasetError, match=r"expected stamps of /cam/depth.*message 0.*times of reception"):
        open_dataset(path)


@pytest.mark.parametrize("epoch_s", [-START_NS // S, -0.5])
def test_stamps_of_two_clocks_give_way_to_the_times_of_reception(epoch_s: float, tmp_path: Path) -> None:
    gray = restamped(gray_topic(), [int(stamp + epoch_s * S) for stamp in STAMPS_NS])
    path = write(tmp_path, "walk.mcap", depth_topic() + gray + info_topic("/camera_info"))
    with pytest.warns(UserWarning, match="got none among 5 and 5.*the times at which the images were received count"):
        require_recorded_order(open_dataset(path))


def test_a_clock_that_is_set_forwards_is_reported_and_keeps_the_order(tmp_path: Path) -> None:
    stamps_ns = [0, 33_000_000, *STAMPS_NS[2:]]
    entries = restamped(depth_topic(), stamps_ns) + restamped(gray_topic(), stamps_ns) + info_topic("/camera_info")
    with pytest.warns(UserWarning, match=r"1.7e\+09 s between two images of /cam/depth"):
        dataset = opened(tmp_path, entries)
    require_recorded_order(dataset)


ROLLED_NS = {
    "32 bits of ns": [(2**32 - S // 12 + index * S // 30) % 2**32 for index in range(N_FRAMES)],
    "32 bits of us": [(2**32 - 83_333 + index * 33_333) % 2**32 * 1000 for index in range(N_FRAMES)],
    "32 bits of us, signed": [
        ((2**31 - 83_333 + index * 33_333) % 2**32 + 2**31) % 2**32 * 1000 - 2**31 * 1000 for index in range(N_FRAMES)
    ],
}
"""Stamps of clocks that begin again after the third image."""


@pytest.mark.parametrize(("clock", "layout", "rolled"), [
    ("32 bits of ns", "walk.mcap", "depth"),
    ("32 bits of ns", "walk.bag", "both"),
    ("32 bits of us", "walk.db3", "both"),
    ("32 bits of us", "walk.mcap", "gray"),
    ("32 bits of us, signed", "walk.db3", "both"),
])  # fmt: skip
def test_a_clock_that_rolls_over_loses_no_frame_and_is_reported(
    clock: str, layout: str, rolled: str, tmp_path: Path
) -> None:
    stamps_ns = ROLLED_NS[clock]
    depth, gray = (restamped(topic, stamps_ns) for topic in (depth_topic(), gray_topic()))
    depth, gray = (depth_topic() if rolled == "gray" else depth), (gray_topic() if rolled == "depth" else gray)
    with pytest.warns(UserWarning, match="message 3 after .* the times at which the images were received count"):
        dataset = open_dataset(write(tmp_path, layout, depth + gray + info_topic("/camera_info")))
    require_recorded_order(dataset)


@pytest.mark.parametrize(("layout", "first_ns", "has_stamps"), [
    ("walk.mcap", -S // 12, True), ("walk-mcap", -10 * S, False), ("walk.mcap", -S // 12, False),
    ("walk-mcap", -10 * S, True), ("walk.db3", -S // 12, False),
])  # fmt: skip
def test_times_before_1970_that_are_stored_unsigned_lose_no_frame(
    layout: str, first_ns: int, has_stamps: bool, tmp_path: Path
) -> None:
    """A recorder whose clock was at 0 when it began: MCAP has numbers without a sign."""
    times_ns = [first_ns + index * S // 30 for index in range(N_FRAMES)]
    stamps_ns = STAMPS_NS if has_stamps else [START_NS] * N_FRAMES
    topics = [restamped(topic, stamps_ns) for topic in (depth_topic(), gray_topic())]
    stored_ns = [time_ns % 2**64 if "mcap" in layout else time_ns for time_ns in times_ns]
    path = write_bag(tmp_path / layout, received_at(stored_ns, *topics, info_topic("/camera_info")))
    with nullcontext() if has_stamps else pytest.warns(UserWarning, match="times at which the images were received"):
        dataset = open_dataset(path)
    require_recorded_order(dataset)
    expected_ns = STAMPS_NS if has_stamps else times_ns
    assert [dataset.header(index).stamp_ns for index in range(N_FRAMES)] == expected_ns


def test_an_index_that_lacks_messages_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path, "walk.mcap", whole())
    monkeypatch.setattr(Bag, "recorded", lambda bag, topic: list(range(N_FRAMES + 1)))
    with pytest.raises(DatasetError, match=r"/cam/depth.* indexed by the times of its 6 messages, got 5, .*recover"):
        open_dataset(path)


# Which topics belong together


def two_cameras() -> list[Entry]:
    """A stereo pair and a colour camera, with depth of both, named as realsense-ros does."""
    colour = [image(np.repeat(gray_of(i)[..., None], 3, 2), "rgb8", (t, "left")) for i, t in enumerate(STAMPS_NS)]
    return [
        *depth_topic("/camera/depth/image_rect_raw"), *info_topic("/camera/depth/camera_info"),
        *gray_topic("/camera/infra1/image_rect_raw"), *info_topic("/camera/infra1/camera_info"),
        *gray_topic("/camera/infra2/image_rect_raw"), *info_topic("/camera/infra2/camera_info", baseline_m=0.05),
        *images("/camera/color/image_raw", colour), *info_topic("/camera/color/camera_info", OTHER),
        *depth_topic("/camera/aligned_depth_to_color/image_raw"),
        *info_topic("/camera/aligned_depth_to_color/camera_info", OTHER),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("depth", "camera"), [("/camera/depth/image_rect_raw", CAMERA), ("/camera/aligned_depth_to_color/image_raw", OTHER)]
)
def test_the_gray_image_is_that_of_the_camera_of_the_depth(depth: str, camera: Intrinsics, tmp_path: Path) -> None:
    path = write(tmp_path, "walk.mcap", two_cameras())
    listed = r"/camera/aligned_depth_to_color/image_raw \(16UC1\), /camera/depth/.*; choose one with --depth-topic"
    with pytest.raises(DatasetError, match=rf"walk\.mcap has several images of depth .*{listed}"):
        open_dataset(path)
    dataset = open_dataset(path, depth_topic=depth)
    require_camera(dataset, camera, 0.05)
    require_frames(dataset)


def test_a_topic_that_is_not_there_is_refused_with_those_that_are(tmp_path: Path) -> None:
    path = write(tmp_path, "walk.mcap", two_cameras())
    for options in ({"depth_topic": "/none"}, {"depth_topic": "/camera/depth/image_rect_raw", "gray_topic": "/none"}):
        with pytest.raises(DatasetError, match=r"no images in the topic .*choose one of: /camera/al.*color.*infra2"):
            open_dataset(path, **options)


REALSENSE_DEPTH = "camera_depth_optical_frame"
COLOUR, RIGHT = "/camera/color/image_raw", "/camera/infra2/image_rect_raw"
RAW, RAW_PNG = "/cam/left/image_raw", "/cam/left/image_raw/compressed"
DISTORTED = changed(info_topic("/cam/left/camera_info"), d=np.array([-0.05, 0.06, 0, 0, 0]))
DEPTH_INFO, GRAY_INFO = info_topic("/cam/depth/camera_info"), info_topic("/cam/left/camera_info")


def in_frames(depth: str, gray: str, *, gray_has_info: bool = False) -> list[Entry]:
    """Depth and gray of cameras with some coordinate frames."""
    infos = info_topic("/cam/depth/camera_info", frame_id=depth)
    infos += info_topic("/cam/left/camera_info", frame_id=gray) if gray_has_info else []
    return depth_topic(frame_id=depth) + gray_topic(frame_id=gray) + infos


def beside_colour() -> list[Entry]:
    """Depth that is not aligned with the colour image of another position."""
    pixels = [np.repeat(gray_of(index)[..., None], 3, axis=2) for index in range(N_FRAMES)]
    frames = [image(each, "rgb8", (t, "colour")) for each, t in zip(pixels, STAMPS_NS, strict=True)]
    depth = depth_topic("/camera/depth/image_rect_raw", frame_id="depth")
    return depth + images(COLOUR, frames) + info_topic("/camera/color/camera_info", frame_id="colour")


@pytest.mark.parametrize(
    ("entries", "gray", "mismatch"),
    [
        (depth_topic() + gray_topic(RIGHT) + info_topic("/camera/info"), RIGHT, "is that of the right camera"),
        (
            depth_topic() + gray_topic() + DEPTH_INFO + info_topic("/cam/left/camera_info", OTHER),
            GRAY,
            "has another lens or size by its camera_info",
        ),
        (depth_topic() + gray_topic(RAW) + DISTORTED, RAW, "is distorted by its camera_info"),
        (depth_topic() + compressed_gray(RAW_PNG) + DISTORTED, RAW_PNG, "is distorted by its camera_info"),
        (in_frames("cam0", "cam1"), GRAY, "is in the coordinate frame 'cam1', and the depth in 'cam0'"),
        (in_frames("cam0", "cam1", gray_has_info=True), GRAY, "is in the coordinate frame 'cam1'"),
        (in_frames(REALSENSE_DEPTH, "camera_infra2_optical_frame"), GRAY, "is in the coordinate frame 'camera_infra2"),
        (beside_colour(), COLOUR, "is in the coordinate frame 'colour', and the depth in 'depth'"),
        (
            beside_colour() + info_topic("/camera/depth/camera_info", frame_id="depth"),
            COLOUR,
            "is in the coordinate frame 'colour', and the depth in 'depth'",
        ),
    ],
    ids=["right", "lens", "raw", "raw PNG", "frame", "frame with info", "infra2", "colour", "colour and depth"],
)
def test_a_gray_image_of_another_view_is_refused_with_the_reason_and_taken_only_if_it_is_named(
    entries: list[Entry], gray: str, mismatch: str, tmp_path: Path
) -> None:
    path = write(tmp_path, "walk.mcap", entries)
    with pytest.raises(DatasetError, match=rf"expected images of the camera of .*{gray} \(.*, which {mismatch}"):
        open_dataset(path)
    with pytest.warns(UserWarning, match=rf"{gray} of .* is taken although it {mismatch}"):
        dataset = open_dataset(path, gray_topic=gray)
    require_images(dataset, [1])


@pytest.mark.parametrize(
    "ids", [(REALSENSE_DEPTH, "camera_infra1_optical_frame"), ("/cam_link", "cam_left"), ("", "rear")]
)
def test_names_of_coordinate_frames_that_may_be_of_one_camera_are_accepted(
    ids: tuple[str, str], tmp_path: Path
) -> None:
    assert len(opened(tmp_path, in_frames(*ids))) == N_FRAMES


def test_depth_that_is_aligned_to_a_distorted_image_goes_with_it(tmp_path: Path) -> None:
    colour = "/camera/aligned_depth_to_color"
    entries = depth_topic(f"{colour}/image_raw") + gray_topic(COLOUR)
    for folder in (colour, "/camera/color"):
        entries += changed(info_topic(f"{folder}/camera_info"), d=np.array([-0.05, 0.06, 0, 0, 0]))
    require_frames(opened(tmp_path, entries))


def test_a_rectified_image_is_taken_and_not_the_distorted_one_beside_it(tmp_path: Path) -> None:
    require_frames(opened(tmp_path, depth_topic() + gray_topic(RAW) + gray_topic() + DISTORTED))


def test_the_right_camera_of_the_pair_gives_its_baseline_and_another_pair_none(tmp_path: Path) -> None:
    ours = depth_topic("/robot/cam/depth/image") + gray_topic("/robot/cam/left/image")
    entries = ours + info_topic("/robot/cam/depth/camera_info") + info_topic("/robot/cam/left/camera_info")
    other = info_topic("/robot/stereo/right/camera_info", baseline_m=0.24)
    assert opened(tmp_path, entries + other).intrinsics.baseline_m is None
    right = gray_topic("/robot/cam/right/image") + info_topic("/robot/cam/right/camera_info", baseline_m=0.06)
    dataset = open_dataset(write(tmp_path, "pair.mcap", entries + other + right))
    require_camera(dataset, CAMERA, 0.06)
    require_frames(dataset, [0])


def test_several_gray_images_of_one_camera_are_listed(tmp_path: Path) -> None:
    path = write(tmp_path, "walk.mcap", whole() + gray_topic("/cam/left/image_mono"))
    with pytest.raises(DatasetError, match=r"several images .*/cam/left/image_mono \(mono8\), /cam/left/image_rect"):
        open_dataset(path)
    require_frames(open_dataset(path, gray_topic="/cam/left/image_mono"), [1])


@pytest.mark.parametrize("layout", ["walk.bag", "walk.mcap"])
def test_compressed_images_are_read_where_there_are_no_others(layout: str, tmp_path: Path) -> None:
    copies = compressed_depth() + compressed_gray()
    require_frames(open_dataset(write(tmp_path, layout, copies + DEPTH_INFO + GRAY_INFO)))
    require_frames(open_dataset(write(tmp_path, f"both-{layout}", copies + whole())))


# The camera


def test_the_nearest_camera_info_counts_or_that_of_the_coordinate_frame(tmp_path: Path) -> None:
    images_alone = depth_topic("/depth") + gray_topic("/left/image")
    dataset = open_dataset(write(tmp_path, "one.mcap", images_alone + info_topic("/left/camera_info")))
    assert dataset.intrinsics == CAMERA
    away = changed(info_topic("/right/info", OTHER), header=(S, "far"))
    dataset = open_dataset(write(tmp_path, "two.mcap", images_alone + away + info_topic("/left/camera_info")))
    assert dataset.intrinsics == CAMERA


@pytest.mark.parametrize("layout", ["walk.bag", "walk-sqlite3"])
def test_fields_of_a_calibration_beside_the_bag_count_before_the_camera_info(layout: str, tmp_path: Path) -> None:
    path = write(tmp_path, layout, whole())
    calibration = (path if path.is_dir() else path.parent) / "calibration.toml"
    calibration.write_text("baseline_m = 0.095\n")
    assert open_dataset(path).intrinsics == replace(CAMERA, baseline_m=0.095)
    calibration.write_text(CALIBRATION)
    assert open_dataset(path).intrinsics.baseline_m == 0.07


SMALL = replace(CAMERA, width_px=4, height_px=3)


@pytest.mark.parametrize(
    ("infos", "message"),
    [
        ([], "has no camera_info for /cam/depth/image_rect .*calibration.toml"),
        (
            changed(DEPTH_INFO, p=np.zeros(12), k=np.zeros(9)),
            "message 0 of /cam/depth/camera_info .*describes no camera",
        ),
        (
            DEPTH_INFO[:3] + info_topic("/cam/depth/camera_info", OTHER)[3:] + GRAY_INFO,
            "message 3 of /cam/depth/camera_info .* describes another camera than before",
        ),
        (
            DEPTH_INFO + GRAY_INFO[:3] + info_topic("/cam/left/camera_info", SMALL)[3:],
            "message 3 of /cam/left/camera_info .* describes another camera than before",
        ),
    ],
    ids=["none", "of no camera", "zoom", "size"],
)
def test_a_bag_without_one_camera_is_refused_unless_a_calibration_states_the_whole_camera(
    infos: list[Entry], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path, "walk.mcap", depth_topic() + gray_topic() + infos)
    with pytest.raises(DatasetError, match=message):
        open_dataset(path)
    (tmp_path / "calibration.toml").write_text(CALIBRATION)
    dataset = open_dataset(path)
    require_camera(dataset, CAMERA, 0.07)
    require_frames(dataset)
    (tmp_path / "calibration.toml").write_text("baseline_m = 0.095\n")
    with pytest.raises(DatasetError, match=message.partition(" .*")[0]):
        open_dataset(path)


def test_images_of_another_size_than_the_camera_are_refused(tmp_path: Path) -> None:
    wide = replace(CAMERA, width_px=16)
    dataset = opened(tmp_path, depth_topic() + gray_topic() + info_topic("/info", wide))
    with pytest.raises(DatasetError, match=r"expected 16x6 pixels in .*walk.mcap, as camera_info .*got 8x6"):
        dataset[0]


# librealsense


def realsense(unit_m: float) -> list[Entry]:
    """The topics of a file that librealsense 2.55 wrote, with a camera in `K` alone and 4 bytes after each image."""
    sensor, infos = "/device_0/sensor_0", camera_info(CAMERA, (0, "")) | {"p": np.zeros(12), "r": np.zeros(9)}
    entries = []
    for stream, encoding in (("Depth_0", "mono16"), ("Infrared_1", "8UC1"), ("Infrared_2", "8UC1")):
        pixels = depth_of if encoding == "mono16" else gray_of
        entries += [
            Entry(
                f"{sensor}/{stream}/image/data",
                1000 * index,
                "sensor_msgs/msg/Image",
                image(pixels(index), encoding, (stamp_ns, "left")),
                b"\x6f\x12\x83\x3a",
            )
            for index, stamp_ns in enumerate(STAMPS_NS)
        ]
        entries.append(Entry(f"{sensor}/{stream}/info/camera_info", 1, "sensor_msgs/msg/CameraInfo", infos))
    for option, value in (("Depth_Units", unit_m), ("Stereo_Baseline", 49.9)):
        entries.append(Entry(f"{sensor}/option/{option}/value", 1, FLOAT32, {"data": np.float32(value)}))
    return entries


@pytest.mark.parametrize("unit_m", [0.001, 0.0001])
def test_a_file_of_librealsense_has_its_unit_and_baseline_and_the_left_image(unit_m: float, tmp_path: Path) -> None:
    dataset = open_dataset(write(tmp_path, "rs.bag", realsense(unit_m)))
    require_camera(dataset, CAMERA, 0.0499)
    assert [dataset.header(index) for index in range(N_FRAMES)] == [(stamp, "left") for stamp in STAMPS_NS]
    np.testing.assert_array_equal(dataset[3].depth_m, depth_of(3) / np.float32(round(1 / unit_m)))
    np.testing.assert_array_equal(dataset[3].gray, gray_of(3))


def test_a_file_that_librealsense_itself_writes_is_read(tmp_path: Path) -> None:
    frames = [(depth_of(index), gray_of(index)) for index in range(3)]
    path = record_with_librealsense(tmp_path / "rs.db3", frames, replace(CAMERA, baseline_m=0.018), unit_m=0.0001)
    dataset = open_dataset(path)
    assert len(dataset) == 3
    require_camera(dataset, CAMERA, 0.018)
    for index, (depth, gray) in enumerate(frames):
        np.testing.assert_array_equal(dataset[index].depth_m, depth / np.float32(10_000))
        np.testing.assert_array_equal(dataset[index].gray, gray)


# What is refused


def test_a_bag_without_depth_says_what_it_has(tmp_path: Path) -> None:
    path = write(tmp_path, "walk.mcap", gray_topic() + info_topic("/cam/left/camera_info"))
    with pytest.raises(DatasetError, match=r"expected images of depth \(16UC1, .*got /cam/left/.*mono8"):
        open_dataset(path)
    path = write(tmp_path, "none.bag", info_topic("/cam/left/camera_info"))
    with pytest.raises(DatasetError, match="got no images"):
        open_dataset(path)


def test_compressed_depth_that_cannot_be_decoded_is_named(tmp_path: Path) -> None:
    depth = compressed_topic(f"{DEPTH}/compressedDepth", "16UC1; compressedDepth rvl", [b"RVL"] * N_FRAMES)
    dataset = opened(tmp_path, depth + gray_topic() + info_topic("/camera_info"))
    with pytest.raises(DatasetError, match=r"message 0 of .*compressedDepth .*only whole PNG, TIFF and JPEG are read"):
        dataset[0]


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_bag_that_was_cut_is_found_when_it_is_opened(layout: str, share: float, tmp_path: Path) -> None:
    path = write(tmp_path, layout, whole())
    file = next(file for file in path.iterdir() if file.suffix != ".yaml") if path.is_dir() else path
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(DatasetError, match="cannot read the bag") as caught:
        open_dataset(path)
    assert "\n" not in str(caught.value)


def test_an_image_that_is_sent_twice_at_once_counts_once(tmp_path: Path) -> None:
    again = depth_topic(stamps_ns=STAMPS_NS[:1])
    require_frames(open_dataset(write(tmp_path, "once.bag", again + whole())))
    later = [entry._replace(received_ns=entry.received_ns + S // 100) for entry in again]
    with pytest.warns(UserWarning) as reported:
        open_dataset(write(tmp_path, "later.bag", later + whole()))
    assert "expected stamps of /cam/depth/image_rect" in str(reported[0].message) + str(reported[1].message)


@pytest.mark.parametrize("profile", ["ros1", "    "])
@pytest.mark.parametrize("layout", ["walk.mcap", "walk-mcap"])
def test_an_mcap_file_of_another_profile_is_named_and_not_called_damaged(
    profile: str, layout: str, tmp_path: Path
) -> None:
    path = write(tmp_path, layout, whole())
    file = next(path.glob("*.mcap")) if path.is_dir() else path
    file.write_bytes(file.read_bytes().replace(b"\x04\0\0\0ros2", b"\x04\0\0\0" + profile.encode(), 1))
    with pytest.raises(DatasetError, match=rf"its profile is '{profile}'.*convert it") as caught:
        open_dataset(path)
    assert "repair" not in str(caught.value)


@pytest.mark.parametrize("layout", ["walk-sqlite3", "walk-mcap"])
@pytest.mark.parametrize("compression", ["message", "file"])
def test_bags_that_are_compressed_by_messages_or_files_are_read(layout: str, compression: str, tmp_path: Path) -> None:
    path = write_bag(tmp_path / layout, in_order(whole()), compression)
    require_frames(open_dataset(path))
    if compression == "message":
        require_frames(open_dataset(next(path.glob("walk*"))))


def test_topics_are_for_bags_alone(tmp_path: Path) -> None:
    write_images(tmp_path, {"depth/0.png": depth_of(0), "color/0.png": gray_of(0)})
    (tmp_path / "calibration.toml").write_text(CALIBRATION)
    assert len(open_dataset(tmp_path)) == 1
    with pytest.raises(ConfigError, match="only bags have topics"):
        open_dataset(tmp_path, depth_topic="/depth")
    write(tmp_path, "walk.mcap", whole())
    assert len(open_dataset(tmp_path, depth_topic="/cam/depth/image_rect")) == len(STAMPS_NS)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no pipes with a name")
@pytest.mark.parametrize("layout", ["walk-sqlite3", "walk-mcap"])
def test_a_pipe_in_place_of_a_file_of_a_bag_does_not_hang(layout: str, tmp_path: Path) -> None:
    folder = write(tmp_path, layout, whole())
    (storage,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    storage.unlink()
    os.mkfifo(storage)
    with pytest.raises(DatasetError, match=r"expected files in the bag .* got something else"):
        open_dataset(folder)


def test_two_pairs_of_different_baselines_beside_the_image_give_none(tmp_path: Path) -> None:
    entries = depth_topic("/robot/cam/depth/image") + gray_topic("/robot/cam/left/image")
    entries = entries + info_topic("/robot/cam/depth/camera_info") + info_topic("/robot/cam/left/camera_info")
    for baseline_m in (0.06, 0.12):
        entries += info_topic(f"/robot/cam/right_{100 * baseline_m:.0f}/camera_info", baseline_m=baseline_m)
    assert open_dataset(write(tmp_path, "pairs.mcap", entries)).intrinsics.baseline_m is None
