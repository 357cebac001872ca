"""What the figures were measured on and with."""

import os
import platform
from importlib.metadata import version
from pathlib import Path

import warp as wp

from voxdepth.model import Model

VERSIONED = ("numpy", "opencv-python-headless", "warp-lang", "voxdepth")
"""Packages whose versions may change the figures."""
CPU_INFO = Path("/proc/cpuinfo")


class Machine(Model):
    """The machine, as far as it matters for speed."""

    processor: str
    processors: int
    """How many the system schedules on: cores, or their threads."""
    python: str
    gpus: list[str]
    """Names of the CUDA devices that Warp finds."""
    load: float
    """Mean number of processes that were running in the minute before: if not about 0, they slowed all this down."""
    versions: dict[str, str]

    @classmethod
    def here(cls) -> "Machine":
        """This one, now."""
        return cls(
            processor=processor_name(CPU_INFO.read_text(encoding="utf-8") if CPU_INFO.exists() else ""),
            processors=os.cpu_count() or 1,
            python=platform.python_version(),
            gpus=[str(device.name) for device in wp.get_cuda_devices()],
            load=os.getloadavg()[0],
            versions={name: version(name) for name in VERSIONED},
        )


def processor_name(cpu_info: str) -> str:
    """The name in the text of `/proc/cpuinfo`; the architecture where it has none."""
    for line in cpu_info.splitlines():
        key, _, value = line.partition(":")
        if key.strip() == "model name":
            return value.strip()
    return platform.machine()
