"""Where images are worked on."""

from typing import Literal

from .errors import ConfigError

DeviceName = Literal["cpu", "cuda"]


def require_device(device: str) -> None:
    """Refuse a device that is not there.

    Raises:
        ConfigError: There is no such device here.
    """
    if device == "cpu":
        return
    import warp as wp

    if not wp.is_cuda_available():
        raise ConfigError(f"device = {device!r} was asked for, but Warp finds no CUDA device here: choose 'cpu'")
