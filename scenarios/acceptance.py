"""The acceptance check of a scenario: what its file promises, flown."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from swarm.types import Outcome

from .config import Run, images_of, load_run
from .errors import ScenarioError
from .flight import fly


class Promise(NamedTuple):
    """Something that a scenario guarantees, with what was found."""

    text: str
    kept: bool


def acceptance_run(name: str, seed: int) -> Run:
    """Return a run with the depth, corrector and image size of the scenario's acceptance check."""
    check = load_run(name, seed, {}).scenario.acceptance
    size = images_of(check.width_px, check.height_px, check.decimate)
    return load_run(name, seed, {"rig.depth": check.depth, "corrector": check.corrector, **size})


def check_acceptance(name: str, seeds: Sequence[int], report: Callable[[int, Outcome], None]) -> list[Promise]:
    """Fly the acceptance check of a scenario and return its promises; a metric that no run has is a `ScenarioError`."""
    check, results = load_run(name, 0, {}).scenario.acceptance, []
    for seed in seeds:
        results.append(fly(acceptance_run(name, seed)).result)
        report(seed, results[-1].outcome)
    successes = sum(result.outcome is Outcome.SUCCESS for result in results)
    text = f"{successes} of {len(results)} succeeded, {check.min_success_share:.0%} required"
    promises = [Promise(text, kept=successes >= check.min_success_share * len(results))]
    for metric, largest in check.largest_means.items():
        values = [float(value) for result in results if (value := result.metrics.get(metric)) is not None]
        if not values:
            raise ScenarioError(f"the acceptance check of {name} asks for the metric {metric!r}, which no run has")
        mean = sum(values) / len(values)
        promises.append(Promise(f"{metric} {mean:.3g}, at most {largest:g} allowed", kept=mean <= largest))
    return promises
