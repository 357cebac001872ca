"""Flying one run of a study again, to watch it and to check that it ends in the same way."""

from pathlib import Path

from swarm.types import Outcome

from ..errors import ScenarioError
from ..results.provenance import simulation_versions
from ..runner import fly_and_write
from .design import RunSpec
from .store import RunRecord, StudyData


def find(data: StudyData, prefix: str) -> RunSpec:
    """Return the run whose key begins with a prefix.

    Raises:
        ScenarioError: No key or more than one key begins with it.
    """
    found = [spec for key, spec in data.runs.items() if key.startswith(prefix.lower())]
    if not found:
        raise ScenarioError(
            f"no run's key begins with {prefix!r}: take one from the report, or from voxdepth study export"
        )
    if len(found) > 1:
        raise ScenarioError(f"{len(found)} runs' keys begin with {prefix!r}: give more digits")
    return found[0]


def fly_again(data: StudyData, spec: RunSpec, out: Path, *, record: bool) -> tuple[Path | None, bool | None, str]:
    """Fly a run again and compare its result with that of the study.

    Returns:
        The folder of its files; whether outcome, metrics and contacts equal those of the study, None if the study has
        no result of the run; and the comparison in words.

    Raises:
        ScenarioError: The folder cannot be written.
        KeyboardInterrupt: Ctrl-C was pressed.
    """
    finished = fly_and_write(spec.run, out, record=record)
    before, now = data.records.get(spec.key), RunRecord.of(spec.key, finished)
    if now.outcome is Outcome.INTERRUPTED:
        raise KeyboardInterrupt
    if before is None:
        return finished.folder, None, f"{now.outcome}; the study has no result of this run"
    if now == before:
        return finished.folder, True, f"{now.outcome}: the same as in the study, figure by figure"
    metrics = [name for name in before.metrics if before.metrics[name] != now.metrics.get(name)]
    versions = [name for name, version in simulation_versions().items() if data.versions.get(name) != version]
    verdict = (
        f"{now.outcome}, in the study {before.outcome}: NOT the same; other figures: {', '.join(metrics) or 'none'}; "
        f"other versions: {', '.join(versions) or 'none'}; the study was begun on {data.machine}"
    )
    return finished.folder, False, verdict
