"""What a flight was made with: versions of packages, and a digest of the source that flies."""

import platform

from voxdepth.tools.results.provenance import ALL_SOURCES, CORRECTION, LIBRARY_SOURCES, code_digest, versions

SIMULATION = (*CORRECTION, "llvmlite", "numba", "open3d", "pybullet", "scipy")
"""Packages whose versions may change a rendered image or a flight."""
FLIGHT_SOURCES = (
    *LIBRARY_SOURCES,
    ("sim", ALL_SOURCES),
    ("swarm", ALL_SOURCES),
    ("scenarios", "config.py"),
    ("scenarios", "flight.py"),
)
"""Packages and the patterns of those of their files that determine the result of a run. The settings of a scenario are
part of the key of a run instead, and so is the code of a user's own controller."""
SENSOR_SOURCES = (("sim", ALL_SOURCES), ("scenarios", "sequences.py"))
"""Those that determine a recording."""


def simulation_versions() -> dict[str, str]:
    """Return versions of Python, of the packages that may change a flight, and of the source that flies, as `code`."""
    return {"python": platform.python_version(), **versions(SIMULATION), "code": code_digest(FLIGHT_SOURCES)}
