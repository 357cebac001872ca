"""Flying one run of a study again, to watch it and to check that it ends in the same way."""

from dataclasses import dataclass
from pathlib import Path

from swarm.types import Outcome

from ..errors import ScenarioError
from ..results.provenance import simulation_versions
from ..runner import Finished, fly_and_write
from .design import RunSpec
from .store import RunRecord, StudyData


@dataclass(frozen=True, kw_only=True)
class Replay:
    """The result of flying a run again."""

    folder: Path
    is_same: bool | None
    """Whether outcome, metrics and contacts equal those of the study; None if the study has no result of the run."""
    verdict: str
    """The comparison in words."""


def find(data: StudyData, prefix: str) -> RunSpec:
    """Return the run whose key begins with a prefix.

    Raises:
        ScenarioError: No key or more than one key begins with it.
    """
    found = {spec.key: spec for spec in reversed(data.specs) if spec.key.startswith(prefix.lower())}
    if not found:
        raise ScenarioError(
            f"no run's key begins with {prefix!r}: take one from the report, or from voxdepth study export"
        )
    if len(found) > 1:
        raise ScenarioError(f"{len(found)} runs' keys begin with {prefix!r}: give more digits")
    return next(iter(found.values()))


def fly_again(data: StudyData, spec: RunSpec, out: Path, *, record: bool) -> Replay:
    """Fly a run again and compare its result with that of the study.

    Raises:
        ScenarioError: The folder cannot be written.
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    finished = fly_and_write(spec.run, out, record=record)
    result = finished.result
    if result.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    assert finished.folder is not None  # fly_and_write always writes
    before = data.records.get(spec.key)
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
        difference = _difference(before, finished, data)
        verdict = f"{result.outcome}, in the study {before.outcome}: NOT the same; {difference}"
    return Replay(folder=finished.folder, is_same=same, verdict=verdict)


def _difference(before: RunRecord, finished: Finished, data: StudyData) -> str:
    """List the metrics and the versions that differ."""
    now = finished.result.metrics
    metrics = [name for name in before.metrics if before.metrics[name] != now.get(name)]
    versions = [name for name, version in simulation_versions().items() if data.versions.get(name) != version]
    text = f"other figures: {', '.join(metrics) or 'none'}; other versions: {', '.join(versions) or 'none'}"
    return text + f"; the study was begun on {data.machine}"
