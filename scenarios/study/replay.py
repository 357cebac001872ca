"""Flying a run of a study once more, by its key: to look at it, and to see whether it ends the same."""

from dataclasses import dataclass
from pathlib import Path

from swarm.types import Outcome

from ..errors import ScenarioError
from ..runner import Finished, fly_and_write
from .matrix import RunSpec
from .provenance import installed_versions
from .record import RunRecord
from .store import Contents


@dataclass(frozen=True, kw_only=True)
class Replay:
    """A run that was flown again."""

    folder: Path
    is_same: bool | None
    """Whether outcome, figures and contacts are those of the study; None if it has no result of the run."""
    verdict: str
    """The same for people."""


def find(contents: Contents, prefix: str) -> RunSpec:
    """The run whose key begins so.

    Raises:
        ScenarioError: There is none, or more than one.
    """
    found = {spec.key: spec for spec in reversed(contents.cells) if spec.key.startswith(prefix.lower())}
    if not found:
        raise ScenarioError(
            f"no run's key begins with {prefix!r}: take one from the report, or from voxdepth study export"
        )
    if len(found) > 1:
        raise ScenarioError(f"{len(found)} runs' keys begin with {prefix!r}: give more digits")
    return next(iter(found.values()))


def fly_again(contents: Contents, spec: RunSpec, out: Path, *, record: bool) -> Replay:
    """Fly a run and compare it with the study's.

    Raises:
        ScenarioError: The folder cannot be written.
        KeyboardInterrupt: Ctrl-C.
    """
    finished = fly_and_write(spec.run, out, record=record)
    result = finished.result
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    assert finished.folder is not None  # fly_and_write always writes
    before = contents.records.get(spec.key)
    if before is None:
        verdict = f"{result.outcome}; the study has no result of this run"
        return Replay(folder=finished.folder, is_same=None, verdict=verdict)
    same = (
        before.outcome is result.outcome
        and dict(before.metrics) == dict(result.metrics)
        and before.contacts == result.contacts
    )
    if same:
        verdict = f"{result.outcome}: the same as in the study, figure by figure"
    else:
        difference = _difference(before, finished, contents)
        verdict = f"{result.outcome}, in the study {before.outcome}: NOT the same; {difference}"
    return Replay(folder=finished.folder, is_same=same, verdict=verdict)


def _difference(before: RunRecord, finished: Finished, contents: Contents) -> str:
    """Which figures and which versions are others."""
    now = finished.result.metrics
    figures = [name for name in before.metrics if before.metrics[name] != now.get(name)]
    versions = [name for name, version in installed_versions().items() if contents.versions.get(name) != version]
    text = f"other figures: {', '.join(figures) or 'none'}; other versions: {', '.join(versions) or 'none'}"
    return text + f"; the study was begun on {contents.machine}"
