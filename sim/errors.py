"""Errors raised by the simulator."""


class SimError(Exception):
    """Base of every error that `sim` raises on purpose."""


class SceneError(SimError, ValueError):
    """A scene, or what is placed in it, cannot exist."""


class RenderError(SimError, RuntimeError):
    """A renderer does not work here, or met a body that it cannot draw."""


class SensorError(SimError, ValueError):
    """A camera or depth sensor is configured impossibly."""


class RecordingError(SimError, RuntimeError):
    """A recording cannot be written or read, is damaged, or is none."""
