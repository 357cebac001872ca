"""A release: wheel and source archive are built, checked, installed into new environments, and used.

    python -m tests.release

Each archive is installed alone on every Python that the library supports and this machine has, and the wheel with the
extras of the library, too. Each installation runs what README.md says of the library. Exits with 1 if something fails.
"""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from rich.console import Console

from tests.environments import interpreter, new_environment
from voxdepth.tools.results.table import Table

ROOT = Path(__file__).parents[1]
DIST = ROOT / "dist"
PYTHONS = ("3.11", "3.12", "3.13")
EXTRAS = "evaluate,rerun,ros,learned"
"""Those that wheels of every Python exist for."""
MOST_BYTES = 3_500_000
"""Largest wheel."""
ALONE = (("--version",), ("doctor",), ("correct", "sample"))
WITH_EXTRAS = (
    ("correct", "sample", "--out", "recorded", "--record", "sample.rrd"),
    ("correct", "sample", "--out", "sample.mcap"),
    ("evaluate", "--data", "sample", "--frames", "2", "--methods", "raw,temporal,learned"),
)
"""Commands of the library, and those that need extras."""


class Installation(NamedTuple):
    """An archive in a new environment of a Python."""

    archive: Path
    python: str
    extras: str = ""

    @property
    def title(self) -> str:
        """What is installed where."""
        return f"{self.archive.suffix.removeprefix('.')}{self.extras}, Python {self.python}"


def build() -> None:
    """Build wheel and source archive into `dist/`, and check them; an error says that one is not right."""
    for old in DIST.glob("*"):
        old.unlink()
    subprocess.run([sys.executable, "-m", "build", "-q", ROOT], check=True)
    archives = sorted(DIST.iterdir())
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *archives], check=True)
    (wheel,) = DIST.glob("*.whl")
    subprocess.run([sys.executable, "-m", "check_wheel_contents", wheel], check=True)
    if (size := wheel.stat().st_size) > MOST_BYTES:
        raise SystemExit(f"{wheel.name} has {size} bytes, at most {MOST_BYTES} were expected")
    print(f"{wheel.name}: {size / 1e6:.1f} MB")


def installations() -> Iterator[Installation]:
    """Yield what is tried; a Python that is not here is left out with a line."""
    (wheel,), (source,) = DIST.glob("*.whl"), DIST.glob("*.tar.gz")
    for python in PYTHONS:
        if interpreter(python) is None:
            print(f"Python {python} is left out: there is none here")
            continue
        yield from (
            Installation(wheel, python),
            Installation(wheel, python, f"[{EXTRAS}]"),
            Installation(source, python),
        )


def example() -> str:
    """Return the program in README.md."""
    (code,) = re.findall(r"^```python\n(.*?)^```$", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE)
    return str(code)


def failure_of(installation: Installation, folder: Path) -> str:
    """Install and use an archive in a folder, and return what failed, or an empty text."""
    python = interpreter(installation.python)
    assert python is not None, "only Pythons that are here are tried"
    constraints = ("--constraint", ROOT / "constraints.txt")
    try:
        environment = new_environment(
            folder / "env", python, *constraints, f"{installation.archive}{installation.extras}"
        )
    except subprocess.CalledProcessError as error:
        return f"it cannot be installed: {error}"
    program = environment.with_name("voxdepth")
    commands = [[program, *words] for words in (*ALONE, *(WITH_EXTRAS if installation.extras else ()))]
    for command in (*commands, [environment, "-c", example()]):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"{' '.join(map(str, command[1:3]))}: {done.stderr.strip().rpartition(chr(10))[2]}"
    return ""


def main() -> int:
    """Build, check, install and use; print a table."""
    build()
    rows = []
    for installation in installations():
        with TemporaryDirectory() as folder:
            failure = failure_of(installation, Path(folder))
        rows.append([installation.title, failure or "works"])
        print(*rows[-1], sep=": ", flush=True)
    Table.of("Installations", ["what", "README's lines"], rows).print(Console())
    return int(any(result != "works" for _, result in rows))


if __name__ == "__main__":
    sys.exit(main())
