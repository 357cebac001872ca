"""The matrix of a study: scenario x arm x theta x seed, each cell resolved to all that its run depends on."""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ..config import Run, load_run
from ..errors import ScenarioError
from .study import Arm, Study

KEY_FORMAT = 1
"""Goes into every key; raised when equal runs would not have equal results any more."""

SHORT = 12
"""Digits of a key that are shown."""


@dataclass(frozen=True, kw_only=True)
class RunSpec:
    """One cell of the matrix."""

    scenario: str
    arm: str
    theta: float | None
    """Noise ratio of the sensor model `noisy`; None for the other sensor models."""
    run: Run
    key: str
    """`key_of` the run when the study was begun. It is kept and not computed again, for a later version of this program
    may know more keys of a scenario, and what was flown must still be found."""

    @property
    def short_key(self) -> str:
        """How the key begins: enough to name the run."""
        return shortened(self.key)

    @property
    def label(self) -> str:
        """The cell in words."""
        return f"scenario {self.scenario}, arm {arm_label(self.arm, self.theta)}, seed {self.seed}"

    @property
    def seed(self) -> int:
        """Of everything random in the run."""
        return self.run.seed


def shortened(key: str) -> str:
    """The first digits of a key, which people read and type."""
    return key[:SHORT]


def arm_label(arm: str, theta: float | None) -> str:
    """An arm, with its noise ratio if it has one."""
    return arm if theta is None else f"{arm}, theta {theta:g}"


def key_of(run: Run) -> str:
    """SHA-256 over the canonical JSON of a run and the format of the key, 64 hexadecimal digits.

    Equal runs have equal keys, whatever their arms are called.
    """
    content = {"format": KEY_FORMAT, "run": run.model_dump(mode="json")}
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def expand(study: Study) -> list[RunSpec]:
    """All cells of a study; seeds vary slowest, so that a study cut short has whole pairs.

    Raises:
        ScenarioError: A scenario does not exist, two have one name, or an arm sets an impossible value.
    """
    names = [load_run(scenario, 0, {}).scenario.name for scenario in study.scenarios]
    if len(set(names)) < len(names):
        raise ScenarioError(f"the scenarios of a study must have different names, got {', '.join(names)}")
    return [spec for seed in study.seeds.listed() for spec in _of_seed(study, seed)]


def digest(study: Study, specs: Sequence[RunSpec]) -> str:
    """SHA-256 that tells a study with its resolved scenarios from any other; where their files are is no matter."""
    cells = [f"{spec.scenario} {spec.arm} {spec.theta} {spec.key}" for spec in specs]
    return hashlib.sha256("\n".join([study.model_dump_json(exclude={"scenarios"}), *cells]).encode()).hexdigest()


def _of_seed(study: Study, seed: int) -> Iterator[RunSpec]:
    for scenario in study.scenarios:
        for arm in study.arms:
            if seed in study.seeds.listed(arm.seeds):
                yield from _of_arm(study, scenario, arm, seed)


def _of_arm(study: Study, scenario: str, arm: Arm, seed: int) -> Iterator[RunSpec]:
    for theta in arm.levels:
        try:
            run = load_run(scenario, seed, {**study.changes, **arm.changes_at(theta)})
        except ScenarioError as error:
            raise ScenarioError(f"arm {arm.name!r} of the study {study.name!r}: {error}") from error
        yield RunSpec(scenario=run.scenario.name, arm=arm.name, theta=theta, run=run, key=key_of(run))
