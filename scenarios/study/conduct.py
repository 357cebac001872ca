"""Flying a study: what is missing goes to the executor, what comes back goes into the store."""

import time
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from swarm.controllers import load_controller

from .executor import Executor
from .matrix import RunSpec, expand
from .progress import Pace, Show
from .store import Contents, Store, lock
from .study import Study
from .tally import Tally


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """How to take up a study whose store is already there."""

    resume: bool = False
    """Whether to fly what is missing; otherwise a store with runs in it is refused."""
    retry_errors: bool = False
    """Whether a run that failed before counts as missing."""


def fly_study(study: Study, out: Path, executor: Executor, wishes: Wishes, show: Show) -> Contents:
    """Fly what is missing of a study and keep every run as it ends.

    Args:
        study: What to fly.
        out: Folder of the store; made if it does not exist.
        executor: Flies the runs.
        wishes: About runs that are done already.
        show: Told of every run.

    Returns:
        All that the store holds in the end.

    Raises:
        ScenarioError: The study cannot be resolved, its store cannot be used, or no run can be flown.
        MissionError: A controller cannot be loaded.
        KeyboardInterrupt: Ctrl-C; what has ended is kept.
    """
    specs = expand(study)
    for controller in sorted({spec.run.scenario.mission.controller for spec in specs}):
        load_controller(controller)
    with lock(out), Store.begin(out, study, specs, resume=wishes.resume) as store:
        contents = store.read()
        missing = contents.missing(retry_errors=wishes.retry_errors)
        if missing:
            _fly(missing, store, executor, Tally(contents), show)
        return store.read()


def _fly(missing: list[RunSpec], store: Store, executor: Executor, tally: Tally, show: Show) -> None:
    waiting = {spec.key: spec for spec in missing}
    start_s = time.perf_counter()
    show.update(tally, Pace(elapsed_s=0.0, left_s=None))
    with closing(executor.run(missing)) as runs:
        for done in runs:
            store.add(done)
            del waiting[done.key]
            tally.add(done)
            elapsed_s = time.perf_counter() - start_s
            show.update(tally, Pace(elapsed_s=elapsed_s, left_s=tally.time_left_s(list(waiting.values()), elapsed_s)))
