"""What a flight was made with: versions of packages, and a digest of the source that flies."""

import hashlib
import platform
from functools import cache
from importlib.resources import as_file, files

from voxdepth.tools.provenance import CORRECTION, versions

SIMULATION = (*CORRECTION, "open3d", "pybullet")
"""Packages whose versions may change a rendered image or a flight."""
ALL_SOURCES = "**/*.py"
FLIGHT_SOURCES = (
    ("voxdepth", ALL_SOURCES),
    ("voxdepth", "confidence.toml"),
    ("voxdepth", "networks/*.onnx"),
    ("sim", ALL_SOURCES),
    ("swarm", ALL_SOURCES),
    ("scenarios", "config.py"),
    ("scenarios", "flight.py"),
)
"""Packages and the patterns of those of their files that determine the result of a run. The settings of a scenario are
part of the key of a run instead; a user's own controller is part of neither."""
SENSOR_SOURCES = (("sim", ALL_SOURCES), ("scenarios", "sequences.py"))
"""Those that determine a recording."""
EVALUATION_SOURCES = (
    *FLIGHT_SOURCES,
    ("scenarios", "evaluation/*.py"),
    ("voxdepth", "datasets/*.py"),
    ("voxdepth", "tools/output.py"),
)
"""Those that determine the result of an evaluation of a recording."""
NOT_FLOWN = ("tools", "datasets")
"""Folders of these packages that no flight uses. A pattern that begins with one of them counts."""
DIGEST_DIGITS = 12


def simulation_versions() -> dict[str, str]:
    """Return versions of Python, of the packages that may change a flight, and of the source that flies, as `code`."""
    return {"python": platform.python_version(), **versions(SIMULATION), "code": code_digest(FLIGHT_SOURCES)}


@cache
def code_digest(sources: tuple[tuple[str, str], ...]) -> str:
    """Return the first digits of the SHA-256 of sources, wherever they are installed."""
    content = hashlib.sha256()
    for package, pattern in sources:
        with as_file(files(package)) as folder:
            for path in sorted(folder.glob(pattern)):
                if path.relative_to(folder).parts[0] in NOT_FLOWN and not pattern.startswith(NOT_FLOWN):
                    continue
                content.update(f"{package}/{path.relative_to(folder).as_posix()}\0".encode())
                content.update(path.read_bytes() + b"\0")
    return content.hexdigest()[:DIGEST_DIGITS]
