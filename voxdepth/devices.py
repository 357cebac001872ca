"""Devices that process images: the CPU, or a GPU through Warp, a package that the extra `cuda` installs."""

import ctypes
from importlib.util import find_spec
from typing import Literal

from .errors import ConfigError

DeviceName = Literal["cpu", "cuda", "warp-cpu"]
"""`cpu` runs loops of Numba, `cuda` Warp's kernels on a GPU, and `warp-cpu` the same kernels on the CPU, for all who
want to see them work."""

CUDA_DRIVER = "libcuda.so.1"
"""Library of NVIDIA's driver. Without it there is no GPU, which Warp would print when it starts."""


def has_warp() -> bool:
    """Return whether Warp is installed. It is not imported."""
    return find_spec("warp") is not None


def quiet_warp() -> None:
    """Let Warp report nothing but errors. Call this before Warp starts, which is when it first loads a kernel."""
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR


def cuda_devices() -> tuple[str, ...]:
    """Return the names of the GPUs that Warp finds; none without Warp or without a driver."""
    if not (has_warp() and _has_driver()):
        return ()
    import warp as wp

    quiet_warp()
    return tuple(str(device.name) for device in wp.get_cuda_devices())


def require_device(device: DeviceName) -> None:
    """Raise a `ConfigError` for a device that this machine does not have."""
    if device != "cpu" and not has_warp():
        raise ConfigError(f"device = {device!r} needs Warp: pip install 'voxdepth[cuda]', or choose 'cpu'")
    if device == "cuda" and not cuda_devices():
        raise ConfigError(f"device = {device!r} was asked for, but Warp finds no CUDA device here: choose 'cpu'")


def _has_driver() -> bool:
    try:
        ctypes.CDLL(CUDA_DRIVER)
    except OSError:
        return False
    return True
