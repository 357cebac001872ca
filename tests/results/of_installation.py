"""Results about what a user meets first: sizes of installations, and the time until the first corrected frame."""

import os
import re
import subprocess
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from tests.environments import new_environment
from tests.release import example
from voxdepth.tools.results.table import Column, Table, Value

from .data import ROOT, Data, Made, MissingDataError

EXTRAS = ("rerun", "ros", "evaluate", "cuda", "learned", "noise")
MEGABYTE = 2**20
TOOLS = re.compile(r"(pip|setuptools|wheel|uv|_distutils_hack)\b")
"""Packages of an environment that nothing of ours needs."""


def installation(_: Data) -> Made:
    """What a new installation weighs, and how long its first frame takes."""
    with TemporaryDirectory() as folder:
        environment = Path(folder)
        alone = _installed(environment / "alone", "")
        packages = _sizes(alone)
        whole = sum(packages.values())
        rows: list[list[Value]] = [["none", whole]]
        for extra in EXTRAS:
            added = sum(_sizes(_installed(environment / extra, f"[{extra}]")).values()) - whole
            rows.append([f"`{extra}`", f"+{added:.0f}"])
        everything = sum(_sizes(_installed(environment / "all", "[all,dev]")).values())
        rows.append(["`all` and `dev`, as `make setup` installs them", everything])
        largest = sorted(packages, key=lambda name: -packages[name])[:4]
        first = [["on a new machine", _first_frame_s(alone, environment)]]
        first.append(["in a new process", _first_frame_s(alone, environment)])
    size = Column("size", "MB", ".0f")
    return Made(
        {
            "extras": Table.of("Size of the library's packages, and what an extra adds", ["extra", size], rows),
            "packages": Table.of(
                "The largest packages of the library alone",
                ["package", size],
                [[name, packages[name]] for name in largest],
            ),
            "first": Table.of(
                "From the start of Python to the first corrected frame", ["", Column("time", "s", ".1f")], first
            ),
        }
    )


def _installed(folder: Path, extras: str) -> Path:
    """Install the library into a new environment, and return its Python; without a registry data is missing."""
    try:
        return new_environment(folder, "3.11", "-c", str(ROOT / "constraints.txt"), f"{ROOT}{extras}")
    except subprocess.CalledProcessError as error:
        raise MissingDataError("packages of the registry, which could not be installed") from error


def _sizes(python: Path) -> dict[str, float]:
    """Return the size of each package that was installed [MB], before anything was started."""
    (folder,) = (python.parents[1] / "lib").glob("python*/site-packages")
    found: dict[str, float] = {}
    for path in folder.rglob("*"):
        package = path.relative_to(folder).parts[0].removesuffix(".libs")
        if path.is_file() and not path.is_symlink() and not TOOLS.match(package):
            found[package] = found.get(package, 0.0) + path.stat().st_blocks * 512 / MEGABYTE
    return found


def _first_frame_s(python: Path, folder: Path) -> float:
    """Return how long a new process takes to its first corrected frame [s], with the cache in a folder."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA")}
    start_s = time.perf_counter()
    cached = environment | {"XDG_CACHE_HOME": str(folder / "cache")}
    subprocess.run([python, "-c", example()], check=True, cwd=folder, capture_output=True, env=cached)
    return time.perf_counter() - start_s
