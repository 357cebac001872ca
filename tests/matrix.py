"""Runs the library's tests with the lowest and the newest versions that pyproject.toml allows, on every Python here.

    python -m tests.matrix [--python 3.12] [--versions lowest]

Every Python and choice of versions gets a new environment in `build/matrix`. A test belongs to the library if nothing
that it imports needs a package that only the extras of the testbed bring. This needs uv and nothing else.
"""

import argparse
import ast
import json
import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from tests.environments import interpreter, new_environment

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "build/matrix"
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"lowest": "lowest-direct", "newest": "highest"}
"""How uv chooses among the versions that are allowed. What a dependency itself depends on is always the newest."""
EXTRAS = ("cuda", "evaluate", "learned", "noise", "rerun", "ros", "test")
TESTBED_EXTRAS = ("sim", "gym")
TESTS = ("unit", "property", "integration", "fuzz")
"""The folders of `tests` that are searched. What `packaging` tests is the same on every Python."""
REQUIREMENT = re.compile(r"(?P<name>[\w.-]+)>=(?P<lowest>[\d.]+)")
COMPILE = """
import pkgutil
from importlib import import_module
import voxdepth
from voxdepth.compiled import compile_all
for module in pkgutil.walk_packages(voxdepth.__path__, "voxdepth."):
    import_module(module.name)
compile_all()
"""
"""A program that imports all of the library and compiles its loops, so that no test waits for them."""


class Outcome(NamedTuple):
    """What the tests of one environment came to."""

    python: str
    versions: str
    status: int
    """What pytest ended with, which is 5 if there were no tests."""
    passed: int = 0
    failed: int = 0
    skipped: int = 0
    seconds: float = 0

    @property
    def is_ok(self) -> bool:
        """Whether there were tests, and none failed."""
        return self.status == 0 and self.passed > 0


def required(root: Path, extras: Iterable[str]) -> dict[str, str]:
    """The lowest version that a pyproject.toml allows of all that the library and some extras require, by names."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    texts = [*project["dependencies"], *(text for extra in extras for text in project["optional-dependencies"][extra])]
    found = [match for match in map(REQUIREMENT.match, texts) if match]
    return {re.sub("[._]", "-", match["name"].lower()): match["lowest"] for match in found}


def raised(lowest: Mapping[str, str], installed: Mapping[str, str]) -> list[str]:
    """Say of which distributions there is something higher than the lowest version."""
    return [
        f"{name} {installed[name]} for {bound}"
        for name, bound in lowest.items()
        if name in installed and re.sub(r"(\.0)+$", "", bound) != re.sub(r"(\.0)+$", "", installed[name])
    ]


def library_tests(root: Path = ROOT) -> list[str]:
    """The files of tests that import nothing, and through no file of the checkout, of the testbed's requirements."""
    beyond = required(root, TESTBED_EXTRAS).keys() - required(root, EXTRAS).keys()
    modules = {name.replace("-", "_") for name in beyond}
    files = sorted(path for folder in TESTS for path in (root / "tests" / folder).rglob("test_*.py"))
    return [path.relative_to(root).as_posix() for path in files if not modules & imported(path, root)]


def imported(path: Path, root: Path) -> set[str]:
    """The packages that a file imports, itself or through other files below the root."""
    found: set[str] = set()
    seen, waiting = {path}, [path]
    while waiting:
        packages, files = imports(waiting.pop(), root)
        found |= packages
        waiting += files - seen
        seen |= files
    return found


class _WithoutTypeChecking(ast.NodeTransformer):
    """Removes what only a type checker runs."""

    def visit_If(self, node: ast.If) -> ast.AST | None:
        return None if ast.unparse(node.test) == "TYPE_CHECKING" else self.generic_visit(node)


@cache
def imports(path: Path, root: Path) -> tuple[set[str], set[Path]]:
    """The packages that a file imports anywhere in it, and the files below the root that this runs."""
    package, names = path.relative_to(root).parent.parts, []
    for node in ast.walk(_WithoutTypeChecking().visit(ast.parse(path.read_text(encoding="utf-8")))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) + 1 - node.level] if node.level else ()
            names += [".".join((*above, *filter(None, [node.module]), alias.name)) for alias in node.names]
    modules = {
        root.joinpath(*parts[:i]) for parts in (name.split(".") for name in names) for i in range(1, len(parts) + 1)
    }
    files = {file for module in modules for file in (module.with_suffix(".py"), module / "__init__.py")}
    return {name.partition(".")[0] for name in names}, set(filter(Path.is_file, files))


def counted(report: Path) -> dict[str, int]:
    """How many tests passed, failed and were skipped by a report of pytest in the JUnit format."""
    (suite,) = ElementTree.parse(report).getroot().iter("testsuite")
    n, failures, errors, skipped = (int(suite.attrib[key]) for key in ("tests", "failures", "errors", "skipped"))
    return {"passed": n - failures - errors - skipped, "failed": failures + errors, "skipped": skipped}


def run(version: str, versions: str, tests: Sequence[str]) -> Outcome:
    """Make the environment of a Python with a choice of versions, and run tests in it."""
    print(f"\nPython {version}, {versions} versions", flush=True)
    folder, python, start_s = FOLDER / f"{version}-{versions}", interpreter(version), time.monotonic()
    assert python is not None
    wheels = ("--only-binary", ":all:", "--no-binary", "voxdepth")
    library = ("--editable", f"{ROOT}[{','.join(EXTRAS)}]")
    inside = new_environment(folder, python, "--resolution", RESOLUTIONS[versions], *wheels, *library)
    if versions == "lowest":
        reported = ", ".join(raised(required(ROOT, EXTRAS), listed(folder))) or "none"
        print(f"higher than the lowest, which has no wheel here or none that fits the others: {reported}", flush=True)
    # Another Numba would take what the last has compiled for old, and compile it again.
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "compiled")}
    subprocess.run([inside, "-c", COMPILE], check=True, cwd=ROOT, env=environment)
    report = folder / "report.xml"
    pytest = [inside, "-m", "pytest", "-q", "-n", "2", "--dist", "worksteal", "-m", "not testbed"]
    done = subprocess.run([*pytest, f"--junit-xml={report}", *tests], check=False, cwd=ROOT, env=environment)
    counts = counted(report) if report.is_file() else {}
    return Outcome(version, versions, done.returncode, **counts, seconds=time.monotonic() - start_s)


def listed(folder: Path) -> dict[str, str]:
    """The versions of the distributions in an environment."""
    command = [sys.executable, "-m", "uv", "--quiet", "pip", "list", "--format", "json", "--python", str(folder)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return {each["name"].lower(): each["version"] for each in json.loads(done.stdout)}


def table(outcomes: Iterable[Outcome]) -> str:
    """The outcomes as lines of text."""
    rows = [
        (o.python, o.versions, *map(str, o[3:6]), f"{o.seconds:.0f}", "ok" if o.is_ok else "FAILED") for o in outcomes
    ]
    head = ("Python", "versions", "passed", "failed", "skipped", "seconds", "")
    return "\n".join("  ".join(f"{cell:8}" for cell in row).rstrip() for row in (head, *rows))


def chosen(arguments: Sequence[str] | None) -> list[tuple[str, str]]:
    """The Pythons and the versions that are requested; those that make no sense end the program with one line."""
    parser = argparse.ArgumentParser(prog="python -m tests.matrix", usage=argparse.SUPPRESS)
    parser.add_argument("--python", choices=PYTHONS, help="one Python, in place of all that are here")
    parser.add_argument("--versions", choices=RESOLUTIONS, help="one choice of versions, in place of both")
    options = parser.parse_args(arguments)
    wanted = [options.python] if options.python else PYTHONS
    absent = [version for version in wanted if interpreter(version) is None]
    if len(absent) == len(wanted):
        parser.error(f"there is no Python {' or '.join(absent)} on the path or below pyenv; install one")
    if find_spec("uv") is None:
        parser.error("this Python has no uv, which makes the environments: pip install uv")
    for version in absent:
        print(f"Python {version} is left out: there is none here")
    present = [version for version in wanted if version not in absent]
    return [
        (version, versions) for version in present for versions in RESOLUTIONS if options.versions in (None, versions)
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is requested and print a table; 1 if something failed."""
    combinations, tests = chosen(arguments), library_tests()
    print(f"{len(tests)} files of tests need no package of the testbed", flush=True)
    outcomes = []
    for version, versions in combinations:
        try:
            outcomes.append(run(version, versions, tests))
        except subprocess.CalledProcessError as error:
            print(
                f"Python {version}, {versions} versions: their environment cannot be made; the lines above say why",
                file=sys.stderr,
            )
            outcomes.append(Outcome(version, versions, error.returncode))
    print(f"\n{table(outcomes)}")
    return 0 if all(outcome.is_ok for outcome in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
