"""Outputs of workloads: computed in a process of their own, kept in files, and compared leaf by leaf.

    python -m tests.outputs FOLDER [WORKLOAD ...]

computes workloads and leaves a file for each of them in a folder.
"""

import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from voxdepth.errors import VoxDepthError

Leaves = Mapping[str, np.ndarray]
"""The numbers and texts of a workload, by their path in its value."""
UNSTEADY = ("timings_s", "drone", "intrinsics")
"""Fields that are left out: times of this machine, and what is the same in every workload."""


def leaves(value: Any, path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Yield the arrays, numbers and texts of anything that is made of them, each with its path."""
    if is_dataclass(value) and not isinstance(value, type):
        value = {one.name: getattr(value, one.name) for one in fields(value) if one.name not in UNSTEADY}
    elif isinstance(value, tuple) and hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, Mapping):
        for key, part in value.items():
            yield from leaves(part, f"{path}/{key}")
    elif isinstance(value, Sequence) and not isinstance(value, str):
        for key, part in enumerate(value):
            yield from leaves(part, f"{path}/{key}")
    else:
        array = np.asarray(value)
        yield path, array if array.dtype.kind in "biuf" else np.asarray(str(value))


def path_of(folder: Path, workload: str) -> Path:
    """The file of a workload in a folder."""
    return folder / f"{quote(workload, safe=' ')}.npz"


def keep(folder: Path, workload: str, value: Any) -> None:
    """Write the value of a workload."""
    folder.mkdir(parents=True, exist_ok=True)
    np.savez(path_of(folder, workload), **{f"leaf{path}": array for path, array in leaves(value)})


def kept(folder: Path, workload: str) -> Leaves:
    """Read the value of a workload."""
    with np.load(path_of(folder, workload), allow_pickle=False) as file:
        return {path.removeprefix("leaf"): file[path] for path in file.files}


@dataclass(frozen=True, kw_only=True)
class Difference:
    """What differs between two values of a workload."""

    workload: str
    parts: int
    """Number of leaves that differ."""
    of: int
    """Number of leaves."""
    worst: str
    """Path of the leaf that differs the most."""
    size: float
    """Largest difference in that leaf, relative to its largest value; infinite for what cannot be subtracted."""
    text: str
    """The difference in that leaf, to be read."""

    def __str__(self) -> str:
        return f"{self.workload}: {self.parts} of {self.of} values differ, most of all {self.worst}: {self.text}"


def difference(workload: str, before: Leaves, after: Leaves) -> Difference | None:
    """Compare two values of a workload to the bit; None if they are equal."""
    paths = list(before | after)
    differing = [path for path in paths if not _is_same(before.get(path), after.get(path))]
    if not differing:
        return None
    sizes = {path: _size(before.get(path), after.get(path)) for path in differing}
    worst = max(differing, key=lambda path: sizes[path])
    text = _text(before.get(worst), after.get(worst))
    return Difference(workload=workload, parts=len(differing), of=len(paths), worst=worst, size=sizes[worst], text=text)


def _is_same(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return a is not None and b is not None and (a.dtype, a.shape) == (b.dtype, b.shape) and a.tobytes() == b.tobytes()


def _are_numbers(a: np.ndarray | None, b: np.ndarray | None) -> bool:
    return a is not None and b is not None and a.shape == b.shape and "U" not in (a.dtype.kind, b.dtype.kind)


def _size(a: np.ndarray | None, b: np.ndarray | None) -> float:
    if not _are_numbers(a, b):
        return float("inf")
    assert a is not None and b is not None
    one, other = (np.nan_to_num(values.astype(np.float64)) for values in (a, b))
    return float(np.abs(one - other).max() / max(np.abs(one).max(), np.abs(other).max(), np.finfo(np.float64).tiny))


def _text(a: np.ndarray | None, b: np.ndarray | None) -> str:
    if a is None or b is None:
        return "it is new" if a is None else "it is gone"
    if not _are_numbers(a, b):
        return f"{a.shape} values became {b.shape}" if a.shape != b.shape else _first_line_that_differs(str(a), str(b))
    if not a.shape:
        return f"{a:.9g} became {b:.9g}"
    one, other = (np.nan_to_num(values.astype(np.float64)) for values in (a, b))
    return f"{(a != b).mean():.2%} of {a.size} numbers differ, by up to {np.abs(one - other).max():.3g}"


def _first_line_that_differs(a: str, b: str) -> str:
    pairs = zip(a.splitlines(), b.splitlines(), strict=False)
    one, other = next(((x, y) for x, y in pairs if x != y), (a, b))
    return f"{one[:60]!r} became {other[:60]!r}"


def compute(root: Path, folder: Path, workloads: Sequence[str], environment: Mapping[str, str]) -> None:
    """Compute workloads of the checkout `root` in a new process under an environment; its failure is an error.

    Raises:
        VoxDepthError: The process failed; the message ends with its last line.
    """
    command = [sys.executable, "-m", "tests.outputs", str(folder), *workloads]
    done = subprocess.run(
        command, cwd=root, env={**environment, "PYTHONPATH": str(root)}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise VoxDepthError(f"the workloads failed with exit status {done.returncode}: {last}")


def main() -> None:
    """Compute the workloads named on the command line, or all of them."""
    from tests.workloads import WORKLOADS

    folder, *names = sys.argv[1:]
    for name in names or WORKLOADS:
        keep(Path(folder), name, WORKLOADS[name]())


if __name__ == "__main__":
    main()
