"""What results were made with."""

import os
import platform
from importlib.metadata import version

from ..bench.machine import CPU_INFO, processor_name
from ..runner import REPORTED_PACKAGES


def installed_versions() -> dict[str, str]:
    """Versions of Python and of the packages that may change a result."""
    return {"python": platform.python_version(), **{name: version(name) for name in REPORTED_PACKAGES}}


def machine() -> str:
    """This machine in one line."""
    text = CPU_INFO.read_text(encoding="utf-8") if CPU_INFO.exists() else ""
    return f"{processor_name(text)}, {os.cpu_count()} logical processors, {platform.machine()}, {platform.system()}"
