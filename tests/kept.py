"""What a change does to all that is computed: every workload of a commit and of this tree, in the same environment.

    python -m tests.kept --against REV [WORKLOAD ...]

Nothing is stored: both are computed again, in processes of their own. What differs is printed with the largest first. A
refactoring is one after which nothing does.
"""

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote

from scenarios.revision import checkout, git
from tests.outputs import Difference, compute, difference, kept
from voxdepth.errors import ConfigError, VoxDepthError

ROOT = Path(__file__).parents[1]
NEEDED = ("tests/workloads.py", "tests/outputs.py")
"""What a commit must hold to be compared."""


@contextmanager
def comparable(rev: str) -> Iterator[Path]:
    """The files of a commit, for as long as they are needed; a commit that cannot be compared is a `VoxDepthError`."""
    with checkout(ROOT, rev) as tree:
        for path in NEEDED:
            if not (tree / path).exists():
                first = git(ROOT, "log", "--diff-filter=A", "--format=%h", "--", path).stdout.decode().split()
                since = f"a later one, from {first[-1]} on" if first else "a later one"
                raise ConfigError(f"commit {rev} has no {path}, so that it cannot be compared: expected {since}")
        yield tree


def differences(rev: str, workloads: Sequence[str]) -> tuple[int, list[Difference], list[str]]:
    """The number of workloads that were compared, what differs, the largest first, and which are gone."""
    with comparable(rev) as before, TemporaryDirectory() as name:
        folders = {root: Path(name) / str(k) for k, root in enumerate((before, ROOT))}
        with ThreadPoolExecutor(len(folders)) as pool:
            list(pool.map(lambda root: compute(root, folders[root], workloads, os.environ), folders))
        old, new = (sorted(unquote(path.stem) for path in folder.iterdir()) for folder in folders.values())
        both = [workload for workload in new if workload in old]
        found = [difference(one, *(kept(folder, one) for folder in folders.values())) for one in both]
        gone = [workload for workload in old if workload not in new]
        return len(both), sorted(filter(None, found), key=lambda each: -each.size), gone


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare a commit with this tree; return 1 if anything differs or is gone."""
    from tests.workloads import WORKLOADS

    parser = argparse.ArgumentParser(prog="python -m tests.kept", description=__doc__.splitlines()[0])
    parser.add_argument("--against", required=True, metavar="REV", help="the commit to compare this tree with")
    parser.add_argument("workload", nargs="*", help="a workload; default: all of them")
    given = parser.parse_args(arguments)
    try:
        for name in given.workload:
            if name not in WORKLOADS:
                raise ConfigError(f"there is no workload {name!r}: expected one of {', '.join(WORKLOADS)}")
        compared, found, gone = differences(given.against, given.workload)
    except VoxDepthError as error:
        print(f"kept: {error}", file=sys.stderr)
        return 2
    for one in found:
        print(one)
    for name in gone:
        print(f"{name}: it is gone")
    print(f"{compared - len(found)} of {compared} workloads are equal to those of {given.against} to the bit")
    return 1 if found or gone else 0


if __name__ == "__main__":
    sys.exit(main())
