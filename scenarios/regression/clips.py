"""The clips on which correctors are compared, and correctors that correct them: here, or as of another revision."""

import json
import os
import subprocess
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from hashlib import sha256
from itertools import product
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol

import numpy as np

from sim.testing import DRONE_ID, FRAMES, LEVELS, TERMS, Level, Term, noisy_sequences
from voxdepth.corrector_spec import CorrectorFactory
from voxdepth.errors import no_such
from voxdepth.tools.evaluation.frames import EvaluationFrame
from voxdepth.types import CorrectedDepth, Intrinsics

from ..errors import ScenarioError
from ..evaluation import evaluation_frames
from ..revision import checkout, top_of
from . import worker

CASES: dict[str, tuple[Term, Level]] = {f"{term}/{level}": (term, level) for term, level in product(TERMS, LEVELS)}
"""Noise term and level by case."""
SEEDS = (0, 1, 2)
"""Seeds of each case: scene, motion and noise."""


class Clip(NamedTuple):
    """A sequence with one kind of noise, and its truth."""

    case: str
    seed: int
    intrinsics: Intrinsics
    frames: Sequence[EvaluationFrame]

    @property
    def title(self) -> str:
        """The case and the seed."""
        return f"{self.case}, seed {self.seed}"

    @property
    def digest(self) -> str:
        """The SHA-256 of all that a corrector gets, and of the truth."""
        digest = sha256(repr(self.intrinsics).encode())
        for frame in self.frames:
            for image in (frame.frame.gray, frame.frame.depth_m, frame.reference_m):
                digest.update(np.ascontiguousarray(image).tobytes())
        return digest.hexdigest()


class Corrected(NamedTuple):
    """The corrections of the frames of a clip."""

    results: Sequence[CorrectedDepth]
    time_ms: float
    """Median time for a frame [ms]."""


class Corrects(Protocol):
    """Corrects clips, each by a new corrector."""

    def __call__(self, clip: Clip) -> Corrected:
        """Correct a clip; the failure of a corrector is a `ScenarioError`."""


def clips(cases: Collection[str] = (), seeds: Sequence[int] = SEEDS) -> Iterator[Clip]:
    """Yield the clips of some cases, or of all, one seed after the other; an unknown case is a `ScenarioError`."""
    cases = cases or tuple(CASES)
    for case in cases:
        if case not in CASES:
            raise ScenarioError(no_such("case", case, tuple(CASES)))
    for seed in seeds:
        sequences = noisy_sequences([CASES[case] for case in cases], seed, frames=FRAMES)
        for case, sequence in zip(cases, sequences, strict=True):
            captures = list(sequence)
            yield Clip(case, seed, captures[0].intrinsics, list(evaluation_frames(captures, [DRONE_ID])))


class Here:
    """Corrects in this process."""

    def __init__(self, make: CorrectorFactory) -> None:
        self._make = make

    def __call__(self, clip: Clip) -> Corrected:
        """See `Corrects`."""
        try:
            results, times_s = worker.correct(self._make, clip.intrinsics, [each.frame for each in clip.frames])
        except worker.CorrectorError as error:
            raise ScenarioError(f"the corrector failed on {clip.title}, {error}") from error
        return Corrected(results, 1000 * median(times_s))


@contextmanager
def at_revision(spec: str, rev: str) -> Iterator[Corrects]:
    """Give the corrector as of a commit of the checkout around the current folder, in a process of its own.

    Raises:
        ScenarioError: There is no such commit, or the code of the corrector is not part of it.
    """
    top = top_of(Path.cwd())
    with checkout(top, rev) as tree, TemporaryDirectory() as name:
        folder = Path(name)
        with (folder / "errors").open("w+b") as errors, _started(spec, top, tree, errors) as process:
            revised = _AtRevision(rev, process, folder)
            code = Path(revised.answer()["code"])
            if not code.is_relative_to(tree):
                raise ScenarioError(
                    f"commit {rev} of {top} does not hold the corrector {spec!r}, whose code is {code}: stand in the "
                    "checkout of that, or compare with a file of --save"
                )
            yield revised


@contextmanager
def _started(spec: str, top: Path, tree: Path, errors: Any) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a worker whose imports come from `tree` where those of this process come from `top`."""
    here = [Path(entry).resolve() for entry in sys.path]
    there = [tree / entry.relative_to(top) for entry in here if entry.is_relative_to(top)]
    path = [*(str(entry) for entry in there if entry.is_dir()), *filter(None, [os.environ.get("PYTHONPATH")])]
    command = [sys.executable, "-P", worker.__file__, spec]
    folder = tree / Path.cwd().resolve().relative_to(top)
    process = subprocess.Popen(
        command,
        cwd=folder if folder.is_dir() else tree,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(path)},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


class _AtRevision:
    """A worker with the code of a commit; clips are passed to it as files in a folder."""

    def __init__(self, rev: str, process: "subprocess.Popen[bytes]", folder: Path) -> None:
        self._rev, self._process, self._folder = rev, process, folder

    def __call__(self, clip: Clip) -> Corrected:
        """See `Corrects`."""
        request = {"clip": str(self._folder / "clip.npz"), "out": str(self._folder / "out.npz")}
        frames = [each.frame for each in clip.frames]
        images: dict[str, Any] = {name: [getattr(f, name) for f in frames] for name in ("stamp_s", "gray", "depth_m")}
        np.savez(request["clip"], **images)
        assert self._process.stdin is not None, "it is a pipe"
        with suppress(BrokenPipeError):  # It ended, and its last line says why.
            self._process.stdin.write(f"{json.dumps(request | {'intrinsics': asdict(clip.intrinsics)})}\n".encode())
            self._process.stdin.flush()
        answer = self.answer()
        if "fault" in answer:
            raise ScenarioError(f"the corrector of {self._rev} failed on {clip.title}, {answer['fault']}")
        with np.load(request["out"], allow_pickle=False) as out:
            corrections = zip(*(out[name] for name in worker.IMAGES), strict=True)
        results = [CorrectedDepth(**dict(zip(worker.IMAGES, each, strict=True))) for each in corrections]
        return Corrected(results, 1000 * median(answer["times_s"]))

    def answer(self) -> dict[str, Any]:
        """Read an answer of the worker; that it ended instead is a `ScenarioError`."""
        assert self._process.stdout is not None, "it is a pipe"
        if line := self._process.stdout.readline():
            answer: dict[str, Any] = json.loads(line)
            return answer
        lines = (self._folder / "errors").read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise ScenarioError(f"the corrector of {self._rev} ended: {lines[-1] if lines else 'without a message'}")
