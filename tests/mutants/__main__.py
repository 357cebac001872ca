"""Make plausible mistakes in a copy of the tree, one at a time, and print which fast test notices each.

It ends with 1 if fewer than 95 % of the mutants of `mutants.toml` are caught. A mutated kernel is compiled again, as
the folder of compiled functions is named after the sources of the package; each copy of the tree keeps its own ones.
"""

import argparse
import os
import re
import subprocess
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import TypeVar

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("mutants.toml")
LEAST_SHARE = 0.95
WORKERS = 2
TIMEOUT_S = 600
"""A mutant whose tests take longer is caught: it does not end."""
PYTEST = (sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist")


Result = TypeVar("Result")


class MutantError(Exception):
    """A mutant, or a run without one, that says nothing about the tests."""


@dataclass(frozen=True)
class Mutant:
    """An edit of one file, and the tests that should notice it."""

    path: str
    what: str
    old: str
    new: str
    tests: tuple[str, ...]

    def apply(self, source: str) -> str:
        """The edited source."""
        if (n := source.count(self.old)) != 1:
            raise MutantError(f"{self.path}: {self.old!r} stands {n} times in it, not once: update the table")
        return source.replace(self.old, self.new)


@dataclass(frozen=True)
class Verdict:
    """What the tests said about a mutant."""

    mutant: Mutant
    caught_by: str | None
    """The first test that failed; None if all passed."""
    seconds: float


def mutants_of(table: Path) -> list[Mutant]:
    """Read the mutants of a table."""
    files = tomllib.loads(table.read_text())["file"]
    return [Mutant(f["path"], what, old, new, tuple(f["tests"])) for f in files for what, old, new in f["mutants"]]


class Copy:
    """A copy of the tree in which one mutant lives at a time."""

    def __init__(self, root: Path, folder: Path) -> None:
        self._folder = folder
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        for name in subprocess.check_output(listed, cwd=root, text=True).rstrip("\0").split("\0"):
            if (root / name).is_file():  # A deleted file is listed until that is committed.
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                copyfile(root / name, folder / name)

    def judge(self, mutant: Mutant) -> Verdict:
        """Make the mutant, run its tests, and undo it."""
        file = self._folder / mutant.path
        source, start_s = file.read_text(), time.monotonic()
        file.write_text(mutant.apply(source))
        try:
            return Verdict(mutant, self.first_failure(mutant.tests), time.monotonic() - start_s)
        finally:
            file.write_text(source)

    def require_passing(self, tests: Sequence[str]) -> None:
        """Run tests without a mutant, which all must pass; otherwise they would catch anything."""
        if tests and (failure := self.first_failure(tests)):
            raise MutantError(f"{failure} fails without a mutant: repair that first")

    def first_failure(self, tests: Sequence[str]) -> str | None:
        """Run the fast tests of files until one fails; its name. Each file compiles only what it imports."""
        return next(filter(None, map(self._failure, tests)), None)

    def _failure(self, tests: str) -> str | None:
        """The name of the first test of a file that fails."""
        places = {"PYTHONPATH": str(self._folder), "NUMBA_CACHE_DIR": str(self._folder / ".numba")}
        environment = os.environ | places | {"PYTHONDONTWRITEBYTECODE": "1"}
        try:
            done = subprocess.run(
                [*PYTEST, tests], cwd=self._folder, env=environment, capture_output=True, text=True, check=False,
                timeout=TIMEOUT_S,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return f"{tests} takes more than {TIMEOUT_S} s"
        failed = re.search(r"^(?:FAILED|ERROR) \S*?([^/\s]+::.+?)(?: - |$)", done.stdout, re.MULTILINE)
        if done.returncode not in (0, 1) or (done.returncode == 1) != (failed is not None):
            last = "\n".join((done.stdout + done.stderr).splitlines()[-15:])
            raise MutantError(f"pytest ended with {done.returncode} on {tests}:\n{last}")
        return failed and failed[1]


def judge_all(mutants: Sequence[Mutant], root: Path) -> Iterator[Verdict]:
    """Yield the verdict on every mutant, in the order of the table."""
    for mutant in mutants:
        mutant.apply((root / mutant.path).read_text())
    with TemporaryDirectory(prefix="mutants-") as folder, ThreadPoolExecutor(WORKERS) as pool:
        copies: SimpleQueue[Copy] = SimpleQueue()
        for k in range(WORKERS):
            copies.put(Copy(root, Path(folder) / str(k)))

        def in_a_copy(work: Callable[[Copy], Result]) -> Result:
            copy = copies.get()
            try:
                return work(copy)
            finally:
                copies.put(copy)

        tests = sorted({test for mutant in mutants for test in mutant.tests})
        parts = [tests[k::WORKERS] for k in range(WORKERS)]
        list(pool.map(lambda part: in_a_copy(lambda copy: copy.require_passing(part)), parts))
        yield from pool.map(lambda mutant: in_a_copy(lambda copy: copy.judge(mutant)), mutants)


def main() -> int:
    """Judge the mutants of the table, and print it."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", default="", metavar="TEXT", help="judge the mutants whose file or text contains this")
    only = parser.parse_args().only
    mutants = [mutant for mutant in mutants_of(TABLE) if only in f"{mutant.path} {mutant.what}"]
    n_caught = 0
    try:
        for verdict in judge_all(mutants, ROOT):
            mutant, caught_by = verdict.mutant, verdict.caught_by
            n_caught += caught_by is not None
            print(f"{mutant.path:34} {mutant.what:60} {verdict.seconds:4.0f} s  {caught_by or 'SURVIVED'}", flush=True)
    except MutantError as error:
        print(f"mutants: {error}", file=sys.stderr)
        return 2
    print(f"{n_caught} of {len(mutants)} mutants caught ({n_caught / max(len(mutants), 1):.0%})")
    return 0 if n_caught >= LEAST_SHARE * len(mutants) else 1


if __name__ == "__main__":
    sys.exit(main())
