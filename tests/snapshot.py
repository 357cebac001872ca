"""Records the results that a refactoring must not change, and compares two such records.

    python -m tests.snapshot record DIR [--project CHECKOUT]
    python -m tests.snapshot compare BEFORE AFTER

`record` runs the command line of a checkout, by default the one in the working directory, and keeps: the metrics and
trajectories of three short missions, all figures of `evaluate` on six frames of every sequence with the cells of its
report, the tables of the experiments on a small sequence, the golden figures of three correctors, and the reports of
the published studies. Whatever depends on the clock is left out. Nothing here is part of the test suite: a record takes
about ten minutes.
"""

import argparse
import csv
import hashlib
import html
import json
import lzma
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

MISSIONS = {
    "city-stereo": ["city", "--seed", "3", "--drones", "4", "--duration", "5", "--corrector", "voxdepth"],
    "gap-noisy": [
        "gap",
        "--seed",
        "1",
        "--duration",
        "5",
        "--depth",
        "noisy",
        "--theta",
        "0.7",
        "--corrector",
        "paper",
    ],
    "crossing-prior": ["crossing", "--seed", "2", "--duration", "5", "--corrector", "realsense", "--prior", "drift"],
}
CORRECTORS = ("raw", "paper", "voxdepth")
STUDIES = ("noise", "correctors", "pair", "pilot")
EXPERIMENTS = ("rq2", "rq3", "rq4", "quality", "components", "window", "switches", "default", "ablation")
CLOCK = re.compile(r"latency|yardstick|wall|fps|workload|[Tt]ime per frame|_time|time_|\bms\b|Hz|speed")
"""What names a figure that depends on how fast the machine is."""


def main() -> None:
    """Record or compare, as the arguments say; exit 1 if a comparison finds a difference."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("out", type=Path)
    recording.add_argument("--project", type=Path, default=Path.cwd())
    recording.add_argument("--only", choices=sorted(PARTS), action="append")
    comparing = commands.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.command == "record":
        record(given.project.resolve(), given.out.resolve(), given.only or list(PARTS))
    elif not compare(given.before, given.after):
        sys.exit(1)


def record(project: Path, out: Path, parts: list[str]) -> None:
    """Write one JSON file of facts per part below `out`."""
    out.mkdir(parents=True, exist_ok=True)
    for name in parts:
        with tempfile.TemporaryDirectory() as scratch:
            facts = dict(PARTS[name](project, Path(scratch)))
        (out / f"{name}.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
        print(f"{name}: {len(facts)} facts", flush=True)


def compare(before: Path, after: Path) -> bool:
    """Print every fact that is missing, new or different; True if there is none."""
    same = True
    for name in PARTS:
        paths = before / f"{name}.json", after / f"{name}.json"
        if not all(path.exists() for path in paths):
            print(f"{name}: not recorded in both")
            continue
        was, now = (json.loads(path.read_text(encoding="utf-8")) for path in paths)
        changed = [key for key in {**was, **now} if was.get(key) != now.get(key)]
        print(f"{name}: {len(was)} facts before, {len(now)} after, {len(changed)} differ")
        for key in changed[:40]:
            print(f"  {key}: {was.get(key)} -> {now.get(key)}")
        same = same and not changed
    return same


Facts = Iterator[tuple[str, object]]


def _missions(project: Path, scratch: Path) -> Facts:
    for name, arguments in MISSIONS.items():
        _voxdepth(project, "run", *arguments, "--no-record", "--out", scratch / name)
        (folder,) = (scratch / name).iterdir()
        metrics = json.loads((folder / "metrics.json").read_text(encoding="utf-8"))
        metrics.pop("wall")
        yield from ((f"{name}/{key}", value) for key, value in _flat(metrics))
        for path in sorted((folder / "trajectories").iterdir()):
            yield f"{name}/{path.name}", hashlib.sha256(path.read_bytes()).hexdigest()


def _evaluation(project: Path, scratch: Path) -> Facts:
    _voxdepth(project, "evaluate", "reference", "hard", "--frames", "6", "--out", scratch)
    with (scratch / "results.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.reader(file) if not CLOCK.search(",".join(row))]
    yield from ((f"row {k}", row) for k, row in enumerate(rows[1:]))
    page = (scratch / "report.html").read_text(encoding="utf-8")
    for k, table in enumerate(re.finditer(r"<table.*?</table>", page, re.S)):
        title = page[: table.start()].rpartition("<h3>")[2].partition("</h3>")[0]
        cells = [
            html.unescape(re.sub(r"<[^>]*>", "", cell)).strip()
            for cell in re.findall(r"<t[dh].*?</t[dh]>", table.group(), re.S)
        ]
        if not CLOCK.search(" ".join([title, *cells])):
            yield f"table {k}", cells


def _experiments(project: Path, scratch: Path) -> Facts:
    options = ["--frames", "20", "--width", "160", "--sequences", "sim-LN,sim-KTC", "--out", scratch]
    for name in EXPERIMENTS:
        _voxdepth(project, "experiment", name, *options, codes=(0, 2))
        for path in sorted((scratch / name).glob("*.csv")) if (scratch / name).exists() else ():
            with path.open(encoding="utf-8", newline="") as file:
                titles, *rows = csv.reader(file)
            kept = [k for k, title in enumerate(titles) if not CLOCK.search(title)]
            for number, row in enumerate(rows):
                if not CLOCK.search(",".join(row)):
                    yield f"{name}/{path.stem}/{number}", [row[k] for k in kept]


def _golden(project: Path, scratch: Path) -> Facts:
    for name in CORRECTORS:
        _voxdepth(project, "regress", "--corrector", name, "--golden", scratch, "--out", scratch, "--update")
        figures = json.loads((scratch / f"{name}.json").read_text(encoding="utf-8"))
        yield from ((f"{name}/{key}", value) for key, value in _flat(figures))


def _studies(project: Path, scratch: Path) -> Facts:
    for name in STUDIES:
        folder = scratch / name
        folder.mkdir()
        packed = project / "docs" / "study" / "earlier" / f"{name}.sqlite.xz"
        (folder / "study.sqlite").write_bytes(lzma.decompress(packed.read_bytes()))
        _voxdepth(project, "study", "report", folder)
        _voxdepth(project, "study", "export", folder)
        report = (folder / "report.md").read_text(encoding="utf-8")
        lines = [line for line in report.splitlines() if line.startswith("|")]
        yield from ((f"{name}/report line {k}", line) for k, line in enumerate(lines))
        yield f"{name}/runs.csv", hashlib.sha256((folder / "runs.csv").read_bytes()).hexdigest()


PARTS: dict[str, Callable[[Path, Path], Facts]] = {
    "missions": _missions,
    "golden": _golden,
    "studies": _studies,
    "evaluation": _evaluation,
    "experiments": _experiments,
}


def _voxdepth(project: Path, *arguments: object, codes: tuple[int, ...] = (0,)) -> None:
    """Run a command of a checkout's own code.

    Raises:
        RuntimeError: It ended with another exit status than those expected.
    """
    code = "import sys; from voxdepth.tools.cli import main; main()"
    command = [sys.executable, "-c", code, *(str(argument) for argument in arguments)]
    done = subprocess.run(command, cwd=project, capture_output=True, text=True, check=False)
    if done.returncode not in codes:
        raise RuntimeError(f"{' '.join(command[3:])} exited {done.returncode}:\n{done.stdout}\n{done.stderr}")


def _flat(tree: object, prefix: str = "") -> Iterator[tuple[str, object]]:
    """The leaves of nested dictionaries and lists with their paths."""
    if isinstance(tree, dict | list):
        items = tree.items() if isinstance(tree, dict) else enumerate(tree)
        for key, value in items:
            yield from _flat(value, f"{prefix}{key}.")
    else:
        yield prefix.rstrip("."), tree


if __name__ == "__main__":
    main()
