"""Make results, and write them into the documents: `python -m tests.results [--recordings FOLDER] [NAME ...]`.

Without a name all are made: first what measures times, alone; then the paper's experiments in a process beside the
others. Results of real cameras need their recordings, one folder each below FOLDER. A result that lacks its data stays
as it was, which is said at the end.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from voxdepth.errors import no_such

from .data import Data, Made, MissingDataError
from .documents import publish
from .makers import MAKERS


def made(names: Sequence[str], data: Data) -> Iterator[tuple[str, Made | MissingDataError]]:
    """Yield each result, or what it lacks, when it is ready."""
    for name in names:
        if (before := MAKERS[name].before) is not None:
            before(data)
    alone = [name for name in names if MAKERS[name].times]
    yield from ((name, make(name, data)) for name in alone)
    beside = [name for name in names if MAKERS[name].before is not None]
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as process:
        longest = {name: process.submit(make, name, data) for name in beside}
        yield from ((name, make(name, data)) for name in names if name not in (*alone, *beside))
        yield from ((name, future.result()) for name, future in longest.items())


def make(name: str, data: Data) -> Made | MissingDataError:
    """Make one result, and say how long it took."""
    print(f"{name}: {MAKERS[name].tells}")
    start_s = time.perf_counter()
    try:
        found = MAKERS[name].make(data)
    except MissingDataError as missing:
        return missing
    print(f"{name}: {(time.perf_counter() - start_s) / 60:.1f} min")
    return found


def main() -> None:
    """Make the results that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", metavar="NAME", nargs="*", help=", ".join(MAKERS))
    parser.add_argument("--recordings", type=Path, metavar="FOLDER", help="folder of the recordings of real cameras")
    arguments = parser.parse_args()
    if unknown := [name for name in arguments.names if name not in MAKERS]:
        parser.error(no_such("result", unknown[0], MAKERS))
    kept = []
    for name, found in made(arguments.names or list(MAKERS), Data(arguments.recordings)):
        if isinstance(found, MissingDataError):
            kept.append(f"{name} stays as it was, without {found}")
        else:
            publish(name, found)
    print("\n".join(kept))


if __name__ == "__main__":
    main()
