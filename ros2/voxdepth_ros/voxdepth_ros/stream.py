"""What the node does with messages; nothing of ROS is imported, so that it is tested without."""

from collections.abc import Mapping
from threading import Condition
from typing import Any, Generic, TypeVar

from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import ConfigError, FrameError
from voxdepth.ros import confidence_fields, depth_fields, frame_of, source_fields
from voxdepth.types import DepthCorrector, Intrinsics

T = TypeVar("T")


class MessageCorrector:
    """Corrects the messages of one camera.

    Args:
        spec: The corrector.
        baseline_m: Baseline of the stereo pair [m]; None takes that of the `CameraInfo`, if it has one.
        units_per_m: Steps of a metre in depth of 16 bits.
    """

    def __init__(self, spec: CorrectorSpec, *, baseline_m: float | None = None, units_per_m: float = 1000.0) -> None:
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
            FrameError: A message is damaged, of another encoding or size, or as old as that before; or the corrector
                does not suit the camera.
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
