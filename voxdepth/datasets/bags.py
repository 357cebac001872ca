"""Bags of ROS 1, ROS 2 and librealsense: images of depth and gray of one camera, with its `camera_info`.

A topic of depth or gray is found by the type of its messages and their encoding, see `voxdepth.ros`; the gray one is of
the same camera as the depth. Images are matched by nearest time within 20 ms, and a frame has the stamp of its depth.
Where no header of a topic has a stamp, the times at which messages were received count.

The `camera_info` lies beside the image, and the baseline is in that of a right camera, whose `P[3]` is negative. A
`calibration.toml` in the folder of the bag counts before both, field by field. Depth of 16 bits is in millimetres.

librealsense stores the topics of a stream below `/device_0/sensor_0/`, where options of the sensor give the unit of the
depth and the baseline in millimetres.
"""

from contextlib import suppress
from pathlib import Path
from typing import Any

from ..errors import DatasetError, FrameError
from ..ros import Header, frame_of
from ..types import Frame, Intrinsics
from .bag_files import SUFFIXES, Bag, bag_in
from .bag_topics import Images, Topics
from .files import CALIBRATION, calibration_path, parse_calibration, read_text, stated
from .pairs import WITHIN_S, associate, require_increasing


class BagDataset:
    """The frames of one camera in a bag.

    Args:
        path: A bag, or a folder with one.
        intrinsics: Intrinsics that take precedence over all others.
        topics: Which images to take.

    Raises:
        DatasetError: The bag is damaged, has no or several images of depth or gray of one camera, no camera, or no two
            images of one time.
        ModuleNotFoundError: The package `rosbags` is not installed.
    """

    format = "bag"

    def __init__(self, path: Path, intrinsics: Intrinsics | None = None, topics: Topics | None = None) -> None:
        found = bag_in(path)
        if found is None:
            raise DatasetError(f"expected a bag in {path}, got none or several: name a file ({', '.join(SUFFIXES)})")
        self._path, bag, topics = path, Bag(found), topics or Topics()
        images = Images(bag)
        depth, gray = images.chosen(topics)
        self.intrinsics = intrinsics or _intrinsics(path, images, depth, gray)
        self._units_per_m = images.units_per_m(depth)
        self._depth, self._gray = bag.stream(depth), bag.stream(gray)
        self._pairs = self._matched()

    @classmethod
    def lacking(cls, path: Path) -> str:
        """What is missing for a bag, in words; empty if there is one."""
        return "" if bag_in(path) else f"one file {' or '.join(SUFFIXES)}, or metadata.yaml of ROS 2"

    def __len__(self) -> int:
        """Number of frames."""
        return len(self._pairs)

    def name(self, index: int) -> str:
        """Number of the frame."""
        return f"{range(len(self))[index]:06d}"

    def header(self, index: int) -> Header:
        """Time of a frame and the coordinate frame of its depth."""
        stamp_ns, depth, _ = self._pairs[index]
        return Header(stamp_ns, self._depth.headers[depth].frame_id)

    def __getitem__(self, index: int) -> Frame:
        """See `Dataset`; a negative index counts from the end."""
        stamp_ns, depth, gray = self._pairs[index]
        try:
            frame = frame_of(
                self._gray[gray], self._depth[depth], stamp_s=stamp_ns / 1e9, units_per_m=self._units_per_m
            )
        except FrameError as error:
            where = f"message {depth} of {self._depth.topic} and {gray} of {self._gray.topic} in {self._path}"
            raise DatasetError(f"{where} give no frame: {error}") from error
        if frame.depth_m.shape != (shape := self.intrinsics.shape):
            raise DatasetError(
                f"expected {shape[1]}x{shape[0]} pixels in {self._path}, as camera_info or {CALIBRATION} says, got "
                f"{frame.depth_m.shape[1]}x{frame.depth_m.shape[0]}; correct the camera, or choose other topics"
            )
        return frame

    def _matched(self) -> list[tuple[int, int, int]]:
        """Stamp [ns] and messages of depth and gray of every frame, in order of time."""
        has_stamps = all(any(header.stamp_ns for header in stream.headers) for stream in (self._depth, self._gray))
        stamps_ns, orders = [], []
        for stream in (self._depth, self._gray):
            stamps = [header.stamp_ns for header in stream.headers] if has_stamps else stream.received_ns
            # Drivers send an image again now and then, with the same time; the first one counts.
            fresh = [index for index, stamp in enumerate(stamps) if index == 0 or stamp != stamps[index - 1]]
            order = sorted(fresh, key=stamps.__getitem__)
            stamps_ns.append([stamps[index] for index in order])
            orders.append(order)
        origin_ns = stamps_ns[0][0]  # The nanoseconds since 1970 do not fit into a float.
        depth_s, gray_s = ([(stamp - origin_ns) / 1e9 for stamp in stamps] for stamps in stamps_ns)
        for seconds, stream in ((depth_s, self._depth), (gray_s, self._gray)):
            require_increasing(seconds, f"{stream.topic} of {self._path}")
        pairs = associate(depth_s, gray_s, within_s=WITHIN_S)
        if not pairs:
            raise DatasetError(
                f"expected images of {self._depth.topic} and {self._gray.topic} within {WITHIN_S} s of each other in "
                f"{self._path}, got none among {len(depth_s)} and {len(gray_s)}; are their clocks the same?"
            )
        return [(stamps_ns[0][i], orders[0][i], orders[1][j]) for i, j in pairs]


def _intrinsics(path: Path, images: Images, depth: str, gray: str) -> Intrinsics:
    """The camera of the depth, or else of the gray image; fields of a calibration beside the bag count before it."""
    calibration = calibration_path(path)
    if calibration.exists():
        known: dict[str, Any] = {}
        with suppress(DatasetError):  # The calibration may be there because the camera_info describes no camera.
            camera = images.camera(depth) or images.camera(gray)
            known = {} if camera is None else stated(camera)
        return parse_calibration(read_text(calibration), calibration, known)
    camera = images.camera(depth) or images.camera(gray)
    if camera is None:
        raise DatasetError(
            f"{path} has no camera_info for {depth} or {gray}; record it, or write the camera into {calibration}"
        )
    return camera
