"""Make results, and write them into the documents: `python -m tests.results [--recordings FOLDER] [NAME ...]`.

Without a name all are made: first what measures times, alone; then the paper's experiments in a process beside the
others. Results of real cameras need their recordings, one folder each below FOLDER. A result that lacks its data stays
as it was, which is said at the end.
"""

import argparse
from pathlib import Path

from voxdepth.errors import no_such

from .data import Data, MissingDataError
from .documents import publish
from .makers import MAKERS, made


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
