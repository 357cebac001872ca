"""What every corrector that remembers frames asks of the next one."""

from .errors import FrameError
from .types import Frame, Intrinsics


def require_size(frame: Frame, intrinsics: Intrinsics) -> None:
    """Refuse a frame of another camera.

    Raises:
        FrameError: The frame has another size than the camera.
    """
    if frame.depth_m.shape != intrinsics.shape:
        raise FrameError(f"frames of this camera have shape {intrinsics.shape}, got {frame.depth_m.shape}")
