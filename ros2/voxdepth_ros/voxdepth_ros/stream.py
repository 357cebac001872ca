"""What the node does with messages; nothing of ROS is imported, so that it is tested without."""

import tomllib
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import median
from threading import Condition
from typing import Any, Generic, Literal, TypeVar

from pydantic import Field

from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import ConfigError, FrameError
from voxdepth.model import Model, changed, explained
from voxdepth.order import FrameOrder, StampOrder, StampStatus
from voxdepth.ros import DEPTH_FIELDS, DepthFields, confidence_fields, depth_fields, frame_of, header_of, source_fields
from voxdepth.types import ASSUMED_BASELINE_M, DepthCorrector, Intrinsics, close
from voxdepth.units import Unit

T = TypeVar("T")
TOPICS = ("image", "depth", "camera_info")
"""What the node subscribes to; the first two are paired."""
MOST_WAITING = 5
"""Images of a topic that wait for one of the other topic."""
INTERVALS = 9
"""Intervals between images of a topic whose median is its period."""
RECENT = 100
"""Latest images of both topics of which those without a partner are counted."""
MANY_ALONE = 10
"""How many of them without a partner are reported: a few are lost at a start, and now and then."""
PATIENCE_S = 5.0
"""Time after which topics without a message are reported [s]."""
TYPICAL = Intrinsics.from_hfov(width_px=640, height_px=480, hfov_deg=80, baseline_m=ASSUMED_BASELINE_M)
"""A camera for which a corrector is made before that of the images is known."""


class Settings(Model):
    """The parameters of the node; they are read when it starts."""

    corrector: str = "temporal"
    """Corrector by name, perhaps with settings, as in `temporal[fill=all]`."""
    config: str = ""
    """TOML file with lines of `voxdepth config` to change; empty takes the defaults."""
    baseline_m: float = Field(default=0.0, ge=0)
    """Baseline of the stereo pair [m]; 0 takes that of the `camera_info`, or else 0.05."""
    units_per_m: float = Field(default=0.0, ge=0)
    """Steps of a metre in the depth; 0 takes 1000 for 16 bits and 1 for floats."""
    slop_s: float = Field(default=0.02, ge=0)
    """Largest difference of the stamps of a pair [s]."""
    depth_encoding: Literal["32FC1", "16UC1"] = "32FC1"
    """Encoding of the depth that is published: metres with NaN for invalid pixels, or millimetres with 0 for them."""

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> "Settings":
        """Return the settings by name; what makes no sense is a `ConfigError` in one line."""
        with explained(cls, ConfigError, "parameters of the node: "):
            return cls.model_validate(dict(given))

    def message_corrector(self) -> "MessageCorrector":
        """Return what corrects the messages; settings that make no sense are a `VoxDepthError`."""
        spec = CorrectorSpec.of(self.corrector)
        if self.config:
            try:
                table = tomllib.loads(Path(self.config).read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise ConfigError(f"cannot read the config {self.config!r} as TOML: {error}") from error
            with explained(CorrectorSpec, ConfigError):
                spec = CorrectorSpec(name=spec.name, config=changed(table, spec.config))
        return MessageCorrector(
            spec,
            baseline_m=self.baseline_m or None,
            units_per_m=self.units_per_m or None,
            depth_fields=DEPTH_FIELDS[self.depth_encoding],
        )


class MessageCorrector:
    """Corrects the messages of one camera.

    Args:
        spec: The corrector.
        baseline_m: Baseline of the stereo pair [m]; None takes that of the `CameraInfo`, or else `ASSUMED_BASELINE_M`.
        units_per_m: Steps of a metre in the depth; None takes 1000 for 16 bits and 1 for floats if the depths fit that.
        depth_fields: Makes the fields of an `Image` of corrected depth [m].

    Raises:
        FrameError: The baseline or the unit makes no sense.
    """

    def __init__(
        self,
        spec: CorrectorSpec,
        *,
        baseline_m: float | None = None,
        units_per_m: float | None = None,
        depth_fields: DepthFields = depth_fields,
    ) -> None:
        self._spec, self._baseline_m, self._units_per_m = spec, baseline_m, units_per_m
        self._depth_fields = depth_fields
        Unit(units_per_m)
        self._typical = replace(TYPICAL, baseline_m=baseline_m or ASSUMED_BASELINE_M)
        self.tell: Callable[[str], None] | None = None
        """Takes a line about every corrector that is made: its camera, and the baseline."""
        self.facts: Mapping[str, str | int | float] = {}
        """What the corrector reports about the last frame, see `Diagnostics`."""
        self._camera: Intrinsics | None = None
        self._corrector: DepthCorrector
        self._order: FrameOrder

    def prepare(self) -> None:
        """Compile what the corrector needs before the first image comes; one that cannot be made is a `ConfigError`."""
        close(self._spec.create(self._typical))

    def correct(self, gray: Any, depth: Any, info: Any) -> Mapping[str, Mapping[str, Any]]:
        """Correct a frame.

        Another camera than before gets a new corrector, but one whose calibration only trembles is the same, see
        `Intrinsics.is_same_camera`. Stamps that go back, as of a bag that begins again, are a new stream, but a single
        frame that comes late is left out, see `voxdepth.order`.

        Returns:
            Fields of the images `depth`, `source` and `confidence`, but for their headers.

        Raises:
            FrameError: A message is damaged, of another encoding, size or unit, or late; or the corrector does not suit
                the camera.
        """
        camera = Intrinsics.from_camera_info(info, baseline_m=self._baseline_m)
        frame = frame_of(gray, depth, units_per_m=self._units_per_m)
        frame.require_shape(camera.shape)
        if self._camera is None or not camera.is_same_camera(self._camera):
            self._begin(camera)
        self._order.admit(frame)
        corrected = self._corrector.process(frame)
        self.facts = {} if corrected.diagnostics is None else corrected.diagnostics.facts()
        return {
            "depth": self._depth_fields(corrected.depth_m),
            "source": source_fields(corrected.source),
            "confidence": confidence_fields(corrected.confidence),
        }

    def _begin(self, camera: Intrinsics) -> None:
        """Make the corrector of a camera."""
        self.close()
        baseline_m = camera.baseline_m or ASSUMED_BASELINE_M
        try:
            self._corrector = self._spec.create(replace(camera, baseline_m=baseline_m))
        except ConfigError as error:
            raise FrameError(f"the corrector does not suit this camera: {error}") from error
        self._camera, self._order = camera, FrameOrder(self._corrector)
        if self.tell is not None:
            assumed = " (assumed: camera_info has none; set baseline_m)" if camera.baseline_m is None else ""
            lens = f"{camera.width_px}x{camera.height_px} pixels, focal length {camera.fx_px:.6g} px"
            self.tell(f"{self._spec.name} corrects a camera of {lens}, baseline {baseline_m:.6g} m{assumed}")

    def close(self) -> None:
        """End the threads of the corrector if it has some."""
        if self._camera is not None:
            close(self._corrector)
        self._camera = None


class Pairs:
    """Pairs the images of two topics by their stamps; each image is in one pair at most.

    Stamps of a pair differ by less than half the period of the faster topic, and are equal before it is known: an image
    is paired with the nearest one, and none with the next one where its own was lost.

    Where the stamps of a topic go back, as of a bag that begins again, images with later stamps no longer wait. The
    synchroniser of `message_filters` in Python would pair nothing until it has caught up with them.

    Args:
        slop_s: Largest difference of the stamps of a pair [s].
    """

    def __init__(self, slop_s: float) -> None:
        self._slop_ns = round(slop_s * 1e9)
        self._topics = (_Topic(), _Topic())
        self._n_alone = 0
        self._recent: deque[bool] = deque(maxlen=RECENT)
        """Whether each of the latest images had no partner."""

    @property
    def n_alone(self) -> int:
        """Images that were left out for want of a partner since both topics have come."""
        return self._n_alone

    def many_alone(self) -> str:
        """Return how many of the latest images had no partner, if it is worth a line, or else an empty text."""
        n_alone = sum(self._recent)
        return f"{n_alone} of the last {len(self._recent)} images" if n_alone >= MANY_ALONE else ""

    def add(self, topic: int, image: Any) -> tuple[Any, Any] | None:
        """Add an image of topic 0 or 1; return it with its partner, in the order of the topics, if that was there."""
        n_before = self._n_waiting() + 1
        have_come = all(each.n for each in self._topics)
        pair = self._added(topic, image)
        n_paired = 0 if pair is None else 2
        if have_come:
            n_alone = n_before - self._n_waiting() - n_paired
            self._n_alone += n_alone
            self._recent.extend([True] * n_alone + [False] * n_paired)
        return pair

    def _n_waiting(self) -> int:
        return sum(len(each.waiting) for each in self._topics)

    def _added(self, topic: int, image: Any) -> tuple[Any, Any] | None:
        stamp_ns, own, other = header_of(image).stamp_ns, self._topics[topic], self._topics[1 - topic]
        if own.classify(stamp_ns) is StampStatus.RESTART:
            for each in self._topics:
                each.drop(lambda waiting_ns: waiting_ns > stamp_ns)
        nearest_ns = min(other.waiting, key=lambda other_ns: abs(other_ns - stamp_ns), default=None)
        if nearest_ns is None or abs(nearest_ns - stamp_ns) > self._reach_ns():
            own.waiting[stamp_ns] = image
            if len(own.waiting) > MOST_WAITING:
                del own.waiting[min(own.waiting)]
            return None
        partner = other.waiting[nearest_ns]
        own.drop(lambda waiting_ns: waiting_ns < stamp_ns)
        other.drop(lambda waiting_ns: waiting_ns <= nearest_ns)
        return (image, partner) if topic == 0 else (partner, image)

    def _reach_ns(self) -> float:
        """Return the largest difference of the stamps of a pair [ns]."""
        periods_ns = [each.period_ns() for each in self._topics if each.is_periodic]
        return min(self._slop_ns, min(periods_ns) / 2) if periods_ns else 0


class _Topic:
    """The images of a topic that wait, by their stamps [ns], and its period."""

    def __init__(self) -> None:
        self.waiting: dict[int, Any] = {}
        self.n = 0
        """Images so far."""
        self._order = StampOrder()
        self._last_ns = 0
        self._intervals_ns: deque[int] = deque(maxlen=INTERVALS)

    def classify(self, stamp_ns: int) -> StampStatus:
        """Take note of the stamp of an image, and tell where it belongs."""
        status = self._order.classify(stamp_ns / 1e9)
        if status is StampStatus.NEXT and self.n:
            self._intervals_ns.append(stamp_ns - self._last_ns)
        if status is not StampStatus.LATE:
            self._last_ns = stamp_ns
        self.n += 1
        return status

    @property
    def is_periodic(self) -> bool:
        """Whether two images have come."""
        return bool(self._intervals_ns)

    def period_ns(self) -> float:
        """Return the usual time between two images."""
        return median(self._intervals_ns)

    def drop(self, is_passed: Callable[[int], bool]) -> None:
        """Drop the waiting images whose stamps [ns] have passed."""
        for stamp_ns in [stamp_ns for stamp_ns in self.waiting if is_passed(stamp_ns)]:
            del self.waiting[stamp_ns]


class Arrivals:
    """When the topics had their last message.

    Args:
        topics: Full names of the topics by what they are for.
        start_s: Time by any clock [s].
        once: Topics of which one message is enough.
    """

    def __init__(self, topics: Mapping[str, str], start_s: float, once: Collection[str] = ()) -> None:
        self.topics, self._start_s, self._once = topics, start_s, once
        self._last_s: dict[str, float] = {}

    def note(self, topic: str, now_s: float) -> None:
        """Take note of a message that has come, at a time by the same clock [s]."""
        self._last_s[topic] = now_s

    def missing(self, now_s: float, published: Callable[[str], Sequence[str]]) -> str:
        """Return what has not come for some seconds, or never, as a line; empty if all has.

        Args:
            now_s: Time by the same clock [s].
            published: Gives the topics with messages of the type of one of ours, by what that is for.
        """
        waited_s = {name: now_s - self._last_s.get(name, self._start_s) for name in self.topics}
        silent = [name for name in self.topics if waited_s[name] >= PATIENCE_S]
        never = [name for name in silent if name not in self._last_s]
        stopped = [name for name in silent if name in self._last_s and name not in self._once]
        notices = {"no message has come yet for": never, "no message has come any more for": stopped}
        lines = [
            f"{text} {'; '.join(self._found(name, published(name)) for name in names)}"
            for text, names in notices.items()
            if names
        ]
        return "; ".join(lines)

    def _found(self, name: str, published: Sequence[str]) -> str:
        """Return what may be wrong with a silent topic."""
        full = self.topics[name]
        if full in published:
            return f"{name} ({full}), which is published"
        others = f": of its type there are {', '.join(published)}" if published else ", nor anything of its type"
        return f"{name} ({full}), which nobody publishes{others}"


class Latest(Generic[T]):
    """Room for one item, in which a newer one replaces one that still waits: what is taken is never old."""

    def __init__(self) -> None:
        self._item: T | None = None
        self._changed = Condition()

    def put(self, item: T) -> bool:
        """Put an item there; whether it replaced one."""
        with self._changed:
            replaced, self._item = self._item is not None, item
            self._changed.notify()
        return replaced

    def take(self, timeout_s: float) -> T | None:
        """Wait for an item and take it; None after a time without one."""
        with self._changed:
            self._changed.wait_for(lambda: self._item is not None, timeout_s)
            item, self._item = self._item, None
            return item
