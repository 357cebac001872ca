"""Errors raised by the simulator."""


class SimError(Exception):
    """Base class of the errors of the simulator."""


class SceneError(SimError, ValueError):
    """A scene, a body or a flight is impossible."""


class RenderError(SimError, RuntimeError):
    """A renderer does not work on this machine, or cannot draw a body."""


class SensorError(SimError, ValueError):
    """A camera or depth sensor has an impossible configuration."""


class RecordingError(SimError, RuntimeError):
    """A recording cannot be written or read, or is damaged."""
