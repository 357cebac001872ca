"""What results were made with."""

import hashlib
import os
import platform
from functools import cache
from importlib.metadata import version
from importlib.resources import as_file, files

from ..benchmark.machine import CPU_INFO, processor_name
from ..runner import REPORTED_PACKAGES

ALL = "**/*.py"
FLYING = (("voxdepth", ALL), ("sim", ALL), ("swarm", ALL), ("scenarios", "config.py"), ("scenarios", "runner.py"))
"""Packages and which of their files decide how a run ends. What scenarios say is part of its key; a controller of your
own is part of neither."""
DIGITS = 12


def installed_versions() -> dict[str, str]:
    """Versions of Python, of the packages that may change a result, and of the code that flies."""
    packages = {name: version(name) for name in REPORTED_PACKAGES}
    return {"python": platform.python_version(), **packages, "code": code_digest()}


@cache
def code_digest() -> str:
    """How the SHA-256 of the sources in `FLYING` begins, wherever they are installed."""
    content = hashlib.sha256()
    for package, pattern in FLYING:
        with as_file(files(package)) as folder:
            for path in sorted(folder.glob(pattern)):
                content.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
                content.update(path.read_bytes() + b"\0")
    return content.hexdigest()[:DIGITS]


def machine() -> str:
    """This machine in one line."""
    text = CPU_INFO.read_text(encoding="utf-8") if CPU_INFO.exists() else ""
    return f"{processor_name(text)}, {os.cpu_count()} logical processors, {platform.machine()}, {platform.system()}"
