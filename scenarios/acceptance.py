"""Whether a scenario still does what its file promises."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from swarm.types import Outcome

from .batch import fly_all
from .config import Run, load_run


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Outcomes of one scenario over seeds."""

    scenario: str
    outcomes: tuple[Outcome, ...]
    required_share: float

    @property
    def successes(self) -> int:
        """Runs that ended in success."""
        return self.outcomes.count(Outcome.SUCCESS)

    @property
    def accepted(self) -> bool:
        """Whether enough runs succeeded."""
        return self.successes >= self.required_share * len(self.outcomes)


def acceptance_run(name: str, seed: int, others: Mapping[str, Any] = MappingProxyType({})) -> Run:
    """A run of a scenario with the depth, corrector and image size of its acceptance check, but for other changes."""
    check = load_run(name, seed, {}).scenario.acceptance
    changes = {
        "rig.depth": check.depth,
        "corrector": check.corrector,
        "rig.width_px": check.width_px,
        "rig.height_px": check.height_px,
    }
    return load_run(name, seed, {**changes, **others})


def check(name: str, seeds: Sequence[int], report: Callable[[int, Outcome], None], *, workers: int) -> Verdict:
    """Fly a scenario's acceptance check; `report` is told of every run."""
    outcomes = []
    runs = [acceptance_run(name, seed) for seed in seeds]
    for seed, finished in zip(seeds, fly_all(runs, workers=workers), strict=True):
        report(seed, finished.result.outcome)
        outcomes.append(finished.result.outcome)
    required = load_run(name, 0, {}).scenario.acceptance.min_success_share
    return Verdict(scenario=name, outcomes=tuple(outcomes), required_share=required)
