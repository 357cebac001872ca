"""What a result was made with: versions of packages, the machine, and the commit of the source."""

import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import as_file, files
from pathlib import Path
from typing import Self

from ...devices import cuda_devices

CORRECTION = ("voxdepth", "numpy", "opencv-python-headless", "warp-lang")
"""Packages whose versions may change a corrected depth."""

ALL_SOURCES = "**/*.py"
LIBRARY_SOURCES = (("voxdepth", ALL_SOURCES), ("voxdepth", "confidence.toml"), ("voxdepth", "networks/*.onnx"))
"""Packages and the patterns of those of their files that determine a corrected depth."""
EVALUATION_SOURCES = (
    *LIBRARY_SOURCES,
    ("voxdepth", "tools/evaluation/*.py"),
    ("voxdepth", "datasets/*.py"),
    ("voxdepth", "tools/output.py"),
)
"""Those that determine the result of an evaluation of a recording."""
UNUSED = ("tools", "datasets")
"""Folders of these packages that no correction uses. A pattern that begins with one of them counts."""
DIGEST_DIGITS = 12
NOT_INSTALLED = "not installed"
CPU_INFO = Path("/proc/cpuinfo")


@dataclass(frozen=True, kw_only=True)
class Provenance:
    """Versions, machine and source, written next to every result."""

    machine: str
    """Processor, number of logical ones, architecture and operating system."""
    python: str
    gpus: tuple[str, ...]
    """Names of the CUDA devices that Warp finds; none if it is not installed."""
    commit: str | None
    """Of the source tree, with a plus sign if files were changed since; None if the code is not in a Git checkout."""
    versions: dict[str, str]

    @classmethod
    def here(cls, packages: Sequence[str] = CORRECTION) -> Self:
        """Return the provenance of a result that is made now in this process."""
        return cls(
            machine=machine(),
            python=platform.python_version(),
            gpus=cuda_devices(),
            commit=source_commit(),
            versions=versions(packages),
        )

    def lines(self) -> list[str]:
        """Return what a reader of a time must know."""
        return [
            f"machine: {self.machine}, Python {self.python}",
            f"GPU: {', '.join(self.gpus) or 'none'}",
            f"versions: {', '.join(f'{name} {version}' for name, version in self.versions.items())}",
        ]


def versions(packages: Sequence[str] = CORRECTION) -> dict[str, str]:
    """Return installed versions by the name of a distribution; `not installed` for one that is missing."""
    found = {}
    for name in packages:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = NOT_INSTALLED
    return found


@cache
def code_digest(sources: tuple[tuple[str, str], ...]) -> str:
    """Return the first digits of the SHA-256 of sources, wherever they are installed."""
    content = hashlib.sha256()
    for package, pattern in sources:
        with as_file(files(package)) as folder:
            for path in sorted(folder.glob(pattern)):
                if path.relative_to(folder).parts[0] in UNUSED and not pattern.startswith(UNUSED):
                    continue
                content.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
                content.update(path.read_bytes() + b"\0")
    return content.hexdigest()[:DIGEST_DIGITS]


def machine() -> str:
    """Describe this machine in one line."""
    return f"{processor_name()}, {os.cpu_count()} logical processors, {platform.machine()}, {platform.system()}"


def processor_name() -> str:
    """Return the name of the processor, or the architecture where the system does not tell it."""
    text = ""
    with suppress(OSError):  # Only Linux has it, and not where /proc is closed.
        text = CPU_INFO.read_text(encoding="utf-8", errors="replace")
    named = re.search(r"^model name\s*:(.*)", text, re.MULTILINE)
    return named[1].strip() if named else platform.machine()


@cache
def source_commit() -> str | None:
    """Return the commit of the checkout of this code, with a plus sign after changes; None outside of a checkout."""
    try:
        _git("ls-files", "--error-unmatch", __file__)  # An installed copy may lie in the checkout of something else.
        commit = _git("rev-parse", "--short=12", "HEAD")
        return f"{commit}+" if _git("status", "--porcelain", "--untracked-files=no") else commit
    except (OSError, subprocess.SubprocessError):
        return None


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, encoding="utf-8", check=True, timeout=10).stdout.strip()
