"""Which topics of a bag are depth, gray and camera of one view."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import DatasetError, FrameError
from ..ros import DEPTH_ENCODINGS, GRAY_ENCODINGS, MILLIMETRES, encoding_of
from ..types import Intrinsics
from .bag_files import CAMERA_INFO, COMPRESSED, IMAGE, Bag

SENSOR_PARTS = 2
"""librealsense puts the streams and options of a sensor below `/device_0/sensor_0`."""
RIGHT_INFRARED = ("/Infrared_2/", "/infra2/")
"""Parts of the topics of the right camera of librealsense and realsense-ros, whose `camera_info` may be that of the
left one."""
COLOURS = [encoding for encoding, (channels, _) in GRAY_ENCODINGS.items() if channels > 1]
"""Encodings of colour images."""
COPIES = ("/compressedDepth", "/compressed")
"""What ends the topic of a compressed copy of an image."""
SAME_LENS = 1e-3
"""Relative difference of the numbers of one lens."""


@dataclass(frozen=True)
class Topics:
    """Topics of the images in a bag; None takes the one that fits."""

    depth: str | None = None
    gray: str | None = None


class Images:
    """The topics of images in a bag, and what is known of their cameras."""

    def __init__(self, bag: Bag) -> None:
        self._bag = bag
        self._images = self._first((IMAGE, COMPRESSED))
        self._infos = self._first((CAMERA_INFO,))

    def chosen(self, topics: Topics) -> tuple[str, str]:
        """Return the topics of depth and gray.

        Raises:
            DatasetError: One that is named does not exist, or none or several fit.
        """
        depth = self._named(topics.depth) or self._only(
            self._of_kind(_is_depth), f"depth ({', '.join(DEPTH_ENCODINGS)})", "--depth-topic"
        )
        gray = self._named(topics.gray) or self._only(
            [topic for topic in self._of_kind(_is_gray) if self._may_be_of(depth, topic)],
            f"the camera of {depth} in gray or colour ({', '.join(GRAY_ENCODINGS)})",
            "--gray-topic",
        )
        return depth, gray

    def camera(self, topic: str) -> Intrinsics | None:
        """Return the camera of an image by the `camera_info` nearest to it, with the baseline of the bag if it has one.

        Raises:
            DatasetError: The `camera_info` describes no camera.
        """
        info = self._info(topic)
        if info is None:
            return None
        try:
            return Intrinsics.from_camera_info(info, baseline_m=self._baseline_m(topic))
        except FrameError as error:
            raise DatasetError(
                f"the camera_info of {topic} in {self._bag.path} describes no camera: {error}"
            ) from error

    def units_per_m(self, topic: str) -> float:
        """Return the steps of a metre in depth of 16 bits."""
        unit_m = self._option(topic, "Depth_Units")
        return float(f"{1 / unit_m:.6g}") if unit_m else MILLIMETRES  # The option is a float of 32 bits.

    def _first(self, kinds: Sequence[str]) -> dict[str, Any]:
        """First messages of all topics of some types that have one."""
        first = {topic: self._bag.first(topic) for topic, kind in self._bag.topics.items() if kind in kinds}
        return {topic: message for topic, message in first.items() if message is not None}

    def _named(self, topic: str | None) -> str | None:
        if topic is not None and topic not in self._images:
            raise DatasetError(
                f"there are no images in the topic {topic} of {self._bag.path}; choose one of: "
                f"{self._listed(self._images)}"
            )
        return topic

    def _only(self, topics: Sequence[str], what: str, option: str) -> str:
        if len(topics) == 1:
            return topics[0]
        if topics:
            raise DatasetError(
                f"{self._bag.path} has several images of {what}: {self._listed(topics)}; choose one with {option}"
            )
        raise DatasetError(
            f"expected images of {what} in {self._bag.path}, got {self._listed(self._images)}; record them, or choose "
            f"one with {option}"
        )

    def _listed(self, topics: Iterable[str]) -> str:
        shown = ((topic, self._images[topic]) for topic in sorted(topics))
        listed = ", ".join(f"{topic} ({getattr(first, 'encoding', None) or first.format})" for topic, first in shown)
        return listed or "no images"

    def _of_kind(self, is_kind: Callable[[Any], bool]) -> list[str]:
        """Topics of a kind of images, without compressed copies of topics that are there as they are."""
        found = [topic for topic, first in self._images.items() if is_kind(first)]
        return [topic for topic in found if _original(topic) == topic or _original(topic) not in found]

    def _may_be_of(self, depth: str, gray: str) -> bool:
        """Whether nothing says that a gray image is of another camera than the depth.

        A colour image in another coordinate frame is: depth must be aligned to it.
        """
        first, second = self._lens(depth), self._lens(gray)
        is_right = any(part in gray for part in RIGHT_INFRARED)
        if first is not None and second is not None:
            return not is_right and _is_same(first, second)
        is_colour = encoding_of(self._images[gray]) in COLOURS
        return not is_right and not (is_colour and self._are_apart(depth, self._images[gray]))

    def _are_apart(self, topic: str, other: Any) -> bool:
        """Whether an image and another message name different coordinate frames."""
        frame_ids = self._images[topic].header.frame_id, other.header.frame_id
        return all(frame_ids) and frame_ids[0] != frame_ids[1]

    def _lens(self, topic: str) -> Intrinsics | None:
        """The camera of an image as its `camera_info` has it; None if it is unknown."""
        info = self._info(topic)
        return None if info is None else _lens_of(info)

    def _info(self, topic: str) -> Any:
        """The `camera_info` that shares most of its path with an image, or has its coordinate frame; None without.

        One that lies elsewhere and names another coordinate frame is of another camera.
        """
        shared = {name: _n_shared(name, topic) for name in self._infos}
        nearest = [name for name, n in shared.items() if n == max(shared.values())]
        if len(nearest) > 1:
            frame_id = self._images[topic].header.frame_id
            nearest = [name for name in nearest if self._infos[name].header.frame_id == frame_id]
        if len(nearest) != 1:
            return None
        info, is_beside = self._infos[nearest[0]], _folder(nearest[0]) == _folder(topic)
        return info if is_beside or not self._are_apart(topic, info) else None

    def _baseline_m(self, topic: str) -> float | None:
        """The baseline of the sensor, or of the only stereo pair whose topics are beside those of the image."""
        in_mm = self._option(topic, "Stereo_Baseline")
        if in_mm:
            return in_mm / 1000
        beside = _folder(_folder(_original(topic))) + "/"
        infos = [info for name, info in self._infos.items() if name.startswith(beside)]
        lenses = [lens for info in infos if (lens := _lens_of(info)) is not None]
        found = {round(lens.baseline_m, 6) for lens in lenses if lens.baseline_m is not None}
        return found.pop() if len(found) == 1 else None

    def _option(self, topic: str, name: str) -> float | None:
        """The value of an option of the sensor of a topic, which files of librealsense have."""
        message = self._bag.first(f"{_sensor(topic)}/option/{name}/value") if _sensor(topic) else None
        try:
            return None if message is None else float(message.data)
        except ValueError as error:
            raise DatasetError(f"expected a number as {name} of {topic} in {self._bag.path}: {error}") from error


def _is_depth(first: Any) -> bool:
    return encoding_of(first) in DEPTH_ENCODINGS


def _is_gray(first: Any) -> bool:
    """Whether it has 8 bits; a compressed image that does not say its encoding has."""
    return encoding_of(first) in GRAY_ENCODINGS or not (hasattr(first, "encoding") or encoding_of(first))


def _lens_of(info: Any) -> Intrinsics | None:
    """The camera of a `camera_info`, with a baseline if it is the right one of a pair; None if it describes none."""
    with suppress(FrameError):
        return Intrinsics.from_camera_info(info)
    return None


def _is_same(first: Intrinsics, second: Intrinsics) -> bool:
    """Whether two cameras have one lens, and none is the right one of a pair."""
    a, b = ((lens.fx_px, lens.fy_px, lens.cx_px, lens.cy_px, *lens.shape) for lens in (first, second))
    return first.baseline_m == second.baseline_m and bool(np.allclose(a, b, rtol=SAME_LENS))


def _original(topic: str) -> str:
    """The topic whose images a topic of compressed images has."""
    return next((topic.removesuffix(end) for end in COPIES if topic.endswith(end)), topic)


def _folder(topic: str) -> str:
    """The part of a topic that the image and the `camera_info` of one camera share."""
    return topic.rsplit("/", 1)[0]


def _sensor(topic: str) -> str:
    """The sensor of a stream in a file of librealsense; empty for other topics."""
    parts = topic.split("/")[1 : 1 + SENSOR_PARTS]
    is_sensor = [part.rstrip("0123456789") for part in parts] == ["device_", "sensor_"]
    return "/" + "/".join(parts) if is_sensor else ""


def _n_shared(first: str, second: str) -> int:
    """Number of parts that two topics have in common from the beginning on."""
    alike = [a == b for a, b in zip(first.split("/"), second.split("/"), strict=False)]
    return alike.index(False) if False in alike else len(alike)
