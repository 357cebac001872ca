"""Make the mistakes of `mutants.toml` in a copy of the tree, one at a time; print which fast test notices each.

It ends with 1 if fewer than 95 % are caught. A mutated kernel is compiled again, as the folder of compiled functions is
named after the sources of the package.
"""

import argparse
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
TABLE = Path(__file__).with_name("mutants.toml")
LEAST_SHARE = 0.95
TIMEOUT_S = 600
"""A mutant whose tests take longer is caught: it does not end."""
PYTEST = (sys.executable, "-m", "pytest", "-x", "-q", "-m", "not slow", "-p", "no:cacheprovider", "-p", "no:xdist")


def copied(folder: Path) -> Path:
    """Copy the files that git knows or would add; a deleted one is listed until that is committed."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    for name in subprocess.check_output(listed, cwd=ROOT, text=True).rstrip("\0").split("\0"):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            copyfile(ROOT / name, folder / name)
    return folder


def first_failure(folder: Path, tests: Sequence[str]) -> str | None:
    """The first fast test that fails in a copy; None if all pass. Each file compiles only what it imports."""
    environment = os.environ | {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / ".numba")}
    for test in tests:
        try:
            done = subprocess.run(
                [*PYTEST, test], cwd=folder, env=environment | {"PYTHONDONTWRITEBYTECODE": "1"},
                capture_output=True, text=True, check=False, timeout=TIMEOUT_S,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return f"{test} takes more than {TIMEOUT_S} s"
        failed = re.search(r"^(?:FAILED|ERROR) \S*?([^/\s]+::.+?)(?: - |$)", done.stdout, re.MULTILINE)
        if done.returncode not in (0, 1) or (done.returncode == 1) != (failed is not None):
            sys.exit(f"mutants: pytest ended with {done.returncode} on {test}:\n{(done.stdout + done.stderr)[-2000:]}")
        if failed:
            return failed[1]
    return None


def main() -> int:
    """Judge the mutants of the table, and print it."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", default="", metavar="TEXT", help="judge the mutants whose file or text contains this")
    only = parser.parse_args().only
    mutants = [
        (file["path"], file["tests"], *mutant)
        for file in tomllib.loads(TABLE.read_text())["file"]
        for mutant in file["mutants"]
        if only in f"{file['path']} {mutant[0]}"
    ]
    for path, _, _, old, _ in mutants:
        if (n := (ROOT / path).read_text().count(old)) != 1:
            sys.exit(f"mutants: {path}: {old!r} stands {n} times in it, not once: update the table")
    n_caught = 0
    with TemporaryDirectory(prefix="mutants-") as name:
        folder = copied(Path(name))
        if failure := first_failure(folder, sorted({test for _, tests, *_ in mutants for test in tests})):
            sys.exit(f"mutants: {failure} fails without a mutant: repair that first")
        for path, tests, what, old, new in mutants:
            source = (folder / path).read_text()
            (folder / path).write_text(source.replace(old, new))
            caught_by = first_failure(folder, tests)
            (folder / path).write_text(source)
            n_caught += caught_by is not None
            print(f"{path:34} {what:60} {caught_by or 'SURVIVED'}", flush=True)
    print(f"{n_caught} of {len(mutants)} mutants caught ({n_caught / max(len(mutants), 1):.0%})")
    return 0 if n_caught >= LEAST_SHARE * len(mutants) else 1


if __name__ == "__main__":
    sys.exit(main())
