"""Devices that process images, and the loading of Warp kernels."""

from types import ModuleType
from typing import Literal

from .errors import ConfigError

DeviceName = Literal["cpu", "cuda"]


def quiet_warp() -> None:
    """Let Warp report nothing but errors. Call this before Warp starts, which is when it first loads a kernel."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR


def load_kernels(module: ModuleType, device: str) -> None:
    """Load a module of Warp kernels on a device, so that the first launch does not compile them."""
    import warp as wp

    quiet_warp()
    wp.load_module(module, device=device)


def require_device(device: str) -> None:
    """Raise a `ConfigError` for a device that this machine does not have."""
    if device == "cpu":
        return
    import warp as wp

    quiet_warp()
    if not wp.is_cuda_available():
        raise ConfigError(f"device = {device!r} was asked for, but Warp finds no CUDA device here: choose 'cpu'")
