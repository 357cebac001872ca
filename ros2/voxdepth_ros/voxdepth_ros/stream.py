"""What the node does with messages; nothing of ROS is imported, so that it is tested without."""

from collections.abc import Callable, Mapping
from threading import Condition
from typing import Any, Generic, TypeVar

from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import ConfigError, FrameError
from voxdepth.ros import confidence_fields, depth_fields, frame_of, header_of, source_fields
from voxdepth.types import DepthCorrector, Intrinsics

T = TypeVar("T")
MOST_WAITING = 5
"""Images of a topic that wait for one of the other topic."""


class MessageCorrector:
    """Corrects the messages of one camera.

    Args:
        spec: The corrector.
        baseline_m: Baseline of the stereo pair [m]; None takes that of the `CameraInfo`, if it has one.
        units_per_m: Steps of a metre in the depth; None takes 1000 for 16 bits and 1 for floats if the depths fit that.
    """

    def __init__(
        self, spec: CorrectorSpec, *, baseline_m: float | None = None, units_per_m: float | None = None
    ) -> None:
        self._spec, self._baseline_m, self._units_per_m = spec, baseline_m, units_per_m
        self._camera: Intrinsics | None = None
        self._corrector: DepthCorrector
        self._stamp_s = 0.0

    def correct(self, gray: Any, depth: Any, info: Any) -> Mapping[str, Mapping[str, Any]]:
        """Correct a frame.

        Another camera than before gets a new corrector, and a stamp before the last one, as of a bag that begins again,
        a new stream.

        Returns:
            Fields of the images `depth`, `source` and `confidence`, but for their headers.

        Raises:
            FrameError: A message is damaged, of another encoding, size or unit, or as old as that before; or the
                corrector does not suit the camera.
        """
        camera = Intrinsics.from_camera_info(info, baseline_m=self._baseline_m)
        frame = frame_of(gray, depth, units_per_m=self._units_per_m)
        frame.require_shape(camera.shape)
        if camera != self._camera:
            self.close()
            self._corrector, self._camera = self._created(camera), camera
        elif frame.stamp_s < self._stamp_s:
            self._corrector.reset()
        corrected = self._corrector.process(frame)
        self._stamp_s = frame.stamp_s
        return {
            "depth": depth_fields(corrected.depth_m),
            "source": source_fields(corrected.source),
            "confidence": confidence_fields(corrected.confidence),
        }

    def _created(self, camera: Intrinsics) -> DepthCorrector:
        try:
            return self._spec.create(camera)
        except ConfigError as error:
            raise FrameError(f"the corrector does not suit this camera: {error}") from error

    def close(self) -> None:
        """End the threads of the corrector if it has some."""
        if self._camera is not None and (close := getattr(self._corrector, "close", None)) is not None:
            close()
        self._camera = None


class Pairs:
    """Pairs the images of two topics by their stamps; each image is in one pair at most.

    After a stamp before the last one of its topic, as of a bag that begins again, images with later stamps no longer
    wait. The synchroniser of `message_filters` in Python would pair nothing until it has caught up with them.

    Args:
        slop_s: Largest difference of the stamps of a pair [s].
    """

    def __init__(self, slop_s: float) -> None:
        self._slop_ns = round(slop_s * 1e9)
        self._waiting: tuple[dict[int, Any], dict[int, Any]] = ({}, {})
        self._last_ns = [0, 0]
        self.n_alone = 0
        """Images that were left out for want of a partner."""

    def add(self, topic: int, image: Any) -> tuple[Any, Any] | None:
        """Add an image of topic 0 or 1; return it with its partner, in the order of the topics, if that was there."""
        n_before = sum(map(len, self._waiting)) + 1
        pair = self._added(topic, image)
        self.n_alone += n_before - sum(map(len, self._waiting)) - (0 if pair is None else 2)
        return pair

    def _added(self, topic: int, image: Any) -> tuple[Any, Any] | None:
        stamp_ns, own, other = header_of(image).stamp_ns, self._waiting[topic], self._waiting[1 - topic]
        if stamp_ns < self._last_ns[topic]:
            for waiting in self._waiting:
                _drop(waiting, lambda waiting_ns: waiting_ns > stamp_ns)
        self._last_ns[topic] = stamp_ns
        nearest_ns = min(other, key=lambda other_ns: abs(other_ns - stamp_ns), default=None)
        if nearest_ns is None or abs(nearest_ns - stamp_ns) > self._slop_ns:
            own[stamp_ns] = image
            if len(own) > MOST_WAITING:
                del own[min(own)]
            return None
        partner = other[nearest_ns]
        own.clear()
        _drop(other, lambda waiting_ns: waiting_ns <= nearest_ns)
        return (image, partner) if topic == 0 else (partner, image)


class Latest(Generic[T]):
    """Room for one item, in which a newer one replaces one that still waits: what is taken is never old."""

    def __init__(self) -> None:
        self._item: T | None = None
        self._changed = Condition()

    def put(self, item: T) -> None:
        """Put an item there."""
        with self._changed:
            self._item = item
            self._changed.notify()

    def take(self, timeout_s: float) -> T | None:
        """Wait for an item and take it; None after a time without one."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None, timeout_s)
            item, self._item = self._item, None
            return item


def _drop(waiting: dict[int, Any], is_passed: Callable[[int], bool]) -> None:
    """Drop the images whose stamps [ns] have passed."""
    for stamp_ns in [stamp_ns for stamp_ns in waiting if is_passed(stamp_ns)]:
        del waiting[stamp_ns]
