"""The design of a study: its scenarios, the arms that it compares, its seeds, and the runs that follow from them."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated, Any, Literal, get_args

import pydantic
from pydantic import Field

from sim.depth_noise import SensorModelName
from swarm.config import DEFAULT_CONTROLLER
from voxdepth import registry
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.errors import VoxDepthError
from voxdepth.model import Model
from voxdepth.plugins import digest_of, source_of
from voxdepth.tools.results.provenance import DIGEST_DIGITS

from ..config import Run, images_of, load_run
from ..errors import ScenarioError
from ..files import Name, load_alone
from ..provenance import simulation_versions

ALWAYS_SET = ("rig.depth", "corrector")
"""Keys that every arm sets, so that the changes of a study could not affect them."""
NOISE_RATIO = "rig.noise.scale.theta"
OWN_KEYS = (*ALWAYS_SET, NOISE_RATIO, "rig.width_px", "rig.height_px")
"""Keys of a scenario that an arm sets by a field of its own."""
EndpointName = Literal["arrived", "collision", "leader_collision"]
"""What is counted: runs in which all arrived without a collision, runs with a collision, or those in which a leader hit
something."""
ENDPOINTS: tuple[EndpointName, ...] = get_args(EndpointName)
GAIN: Literal["gain"] = "gain"
"""The endpoint of a study with an axis: by how much farther along it an arm keeps half of the full goal speed."""
KEY_FORMAT = 2
"""Part of every key. It is raised when equal runs no longer have equal results."""
SHORT = 12
"""Number of digits of a key that are shown."""


def _is_set_by(key: str, own: Sequence[str]) -> bool:
    """Whether a dotted key is one of `own`, or lies in a table that one of them sets."""
    return any(key == one or key.startswith(f"{one}.") for one in own)


def _dotted(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return changes with dotted keys in place of tables, which TOML makes of dotted keys without quotes.

    A table with a `kind` stays whole.
    """
    dotted: dict[str, Any] = {}
    for key, value in changes.items():
        is_table = isinstance(value, Mapping) and "kind" not in value
        dotted |= {f"{key}.{name}": one for name, one in _dotted(value).items()} if is_table else {key: value}
    return dotted


Changes = Annotated[Mapping[str, Any], pydantic.AfterValidator(_dotted)]
"""Values of a scenario to set, by dotted key."""


class Seeds(Model):
    """The seeds with which every arm flies every scenario."""

    count: int = Field(ge=1, le=100_000)
    first: int = Field(default=0, ge=0, le=2**32 - 100_000)

    @property
    def all(self) -> range:
        """The seeds."""
        return range(self.first, self.first + self.count)


class Axis(Model):
    """A setting that makes flights harder step by step, so that every arm has a curve."""

    key: str
    """Its dotted key in a scenario, as in rig.light_stops."""
    unit: str = ""
    levels: tuple[float, ...] = Field(strict=False, min_length=3)
    """Its values from the easiest to the hardest."""
    reference: str | None = None
    """The arm of which half the goal speed is the height at which the curves of the others are compared."""

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Axis":
        if list(self.levels) not in (sorted(set(self.levels)), sorted(set(self.levels), reverse=True)):
            raise ValueError(f"the levels of an axis must rise or fall from the easiest on, got {list(self.levels)}")
        return self


class Arm(Model):
    """One way to fly a scenario: the source of depth, the corrector, and further differences."""

    name: Name
    depth: SensorModelName
    corrector: CorrectorSpec
    """The corrector's name, or a table with `name` and `config`."""
    theta: tuple[float, ...] = ()
    """Noise ratios of the sensor model `noisy`, one or a list; a list is an axis of the arm, from the easiest on. Left
    out where they are the axis of the study."""
    levels: tuple[float, ...] = Field(default=(), strict=False)
    """Levels of the study's axis that this arm flies. Default: all."""
    size: str | None = Field(default=None, pattern=r"^\d+x\d+$")
    """Image size without decimation, as in 160x120. Default: the cameras of the scenario."""
    changes: Changes = Field(default={}, strict=False)
    """Values of the scenario to set, by dotted key."""
    factors: Mapping[str, str] = Field(default={}, strict=False)
    """Place of the arm in a factorial design, as in { policy = "free", corrector = "raw" }: columns of `runs.csv`."""

    @pydantic.field_validator("theta", mode="before")
    @classmethod
    def _as_tuple(cls, theta: Any) -> Any:
        return tuple(theta) if isinstance(theta, list | tuple) else (theta,)

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Arm":
        if self.theta and self.depth != "noisy":
            raise ValueError(
                f"arm {self.name!r}: only the sensor model 'noisy' has theta; got depth {self.depth!r} with theta "
                f"{list(self.theta)}"
            )
        if taken := [key for key in self.changes if _is_set_by(key, OWN_KEYS)]:
            raise ValueError(
                f"arm {self.name!r}: changes must not set {taken[0]}; use the arm's depth, theta, corrector or size"
            )
        return self

    @property
    def settings(self) -> dict[str, Any]:
        """All values of the scenario that the arm sets, by dotted key; a level of the axis goes before them."""
        changes = {**self.changes, "rig.depth": self.depth, "corrector": self.corrector.model_dump()}
        if self.theta:
            changes[NOISE_RATIO] = self.theta[0]
        if self.size is not None:
            width, height = self.size.split("x")
            changes |= images_of(int(width), int(height))
        return changes


class PrimaryComparison(Model):
    """The pre-registered primary comparison, fixed before the first run.

    The p-value of a single one is not adjusted, and those of several, of some arms with one, are for their number.
    """

    arm: tuple[str, ...] = Field(min_length=1)
    """The arm, or a list of arms."""
    against: str
    endpoint: EndpointName | Literal["gain"] = "arrived"
    """What is counted, or `GAIN`."""

    @pydantic.field_validator("arm", mode="before")
    @classmethod
    def _as_tuple(cls, arm: Any) -> Any:
        return tuple(arm) if isinstance(arm, list | tuple) else (arm,)

    @property
    def arms(self) -> tuple[str, ...]:
        """All arms that are compared."""
        return *self.arm, self.against


class Study(Model):
    """A study as its file describes it."""

    name: Name
    description: str = ""
    scenarios: tuple[str, ...] = Field(strict=False, min_length=1)
    """Shipped scenarios by name, or paths of TOML files, relative to the study's file."""
    seeds: Seeds
    pilot: bool = False
    """Whether this is a pilot, which may be used to choose scenes and controllers, as its report says."""
    time_limit_s: float = Field(default=1800.0, gt=0)
    """Wall-clock time after which a run is stopped and counts as an error."""
    changes: Changes = Field(default={}, strict=False)
    """Values to set in every scenario for every arm, by dotted key."""
    axis: Axis | None = None
    """The axis along which every arm flies; None if there is none but noise ratios."""
    declared: PrimaryComparison | None = None
    """The pre-registered primary comparison; None if there is none."""
    arms: tuple[Arm, ...] = Field(strict=False, min_length=1)

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Study":
        for what, names in (("scenario", self.scenarios), ("arm", [arm.name for arm in self.arms])):
            if twice := [name for name, count in Counter(names).items() if count > 1]:
                raise ValueError(f"every {what} may be named once, got {twice[0]!r} more than once")
        if taken := [key for key in self.changes if _is_set_by(key, ALWAYS_SET)]:
            raise ValueError(f"changes must not set {taken[0]}, because every arm sets it: set it in the arms")
        self._check_theta()
        self._check_axis()
        self._check_labels()
        self._check_primary_comparison()
        return self

    @property
    def endpoint(self) -> EndpointName:
        """What is counted in the first place."""
        return "arrived" if self.declared is None or self.declared.endpoint == "gain" else self.declared.endpoint

    @property
    def axis_key(self) -> str:
        """The dotted key of which every run has a level."""
        return NOISE_RATIO if self.axis is None else self.axis.key

    def levels_of(self, arm: Arm) -> tuple[float | None, ...]:
        """Return the levels that an arm flies, from the easiest on; a single None for an arm without any."""
        if self.axis is None:
            return tuple(sorted(set(arm.theta))) or (None,)
        return tuple(level for level in self.axis.levels if level in (arm.levels or self.axis.levels))

    def _check_theta(self) -> None:
        is_axis = self.axis is not None and self.axis.key == NOISE_RATIO
        for arm in self.arms:
            if is_axis and arm.theta:
                raise ValueError(
                    f"arm {arm.name!r} must not set theta, which is the axis: leave it out, or give levels"
                )
            if arm.depth == "noisy" and not (is_axis or arm.theta):
                raise ValueError(
                    f"arm {arm.name!r}: the sensor model 'noisy' needs theta, or it as the axis of the study"
                )

    def _check_axis(self) -> None:
        axis = self.axis
        for arm in self.arms:
            if axis is None and arm.levels:
                raise ValueError(f"arm {arm.name!r} has levels of an axis, which the study lacks: give [axis]")
            if axis is None:
                continue
            if len(arm.theta) > 1:
                raise ValueError(f"arm {arm.name!r} has {len(arm.theta)} theta in a study with an axis, expected one")
            if unknown := [level for level in arm.levels if level not in axis.levels]:
                raise ValueError(f"arm {arm.name!r} flies {unknown[0]:g}, which is no level of the axis")
            if _is_set_by(axis.key, (*ALWAYS_SET, *self.changes, *arm.settings)):
                raise ValueError(f"the axis {axis.key} must not be set by the study or by arm {arm.name!r} as well")
        if axis is not None and axis.reference not in (None, *(arm.name for arm in self.arms)):
            raise ValueError(f"the reference of the axis is no arm of the study: {axis.reference!r}")

    def _check_labels(self) -> None:
        labels = Counter(arm_label(arm.name, level) for arm in self.arms for level in self.levels_of(arm))
        if twice := [label for label, count in labels.items() if count > 1]:
            raise ValueError(f"two arms, or levels, would both be called {twice[0]!r}: name or choose them apart")

    def _check_primary_comparison(self) -> None:
        declared = self.declared
        if declared is None:
            return
        levels = {arm.name: len(self.levels_of(arm)) for arm in self.arms}
        for name in declared.arms:
            if name not in levels:
                raise ValueError(f"the declared comparison names no arm of the study: {name!r}; it has {list(levels)}")
            if declared.endpoint != GAIN and levels[name] > 1:
                count = levels[name]
                raise ValueError(
                    f"a declared comparison needs arms of one level, or endpoint = {GAIN!r}: {name!r} has {count}"
                )
        if twice := [name for name, count in Counter(declared.arms).items() if count > 1]:
            raise ValueError(f"the declared comparison must name two arms, got {twice[0]!r} twice")
        if declared.endpoint == GAIN:
            self._check_gain(declared)

    def _check_gain(self, declared: PrimaryComparison) -> None:
        if len(declared.arm) > 1:
            raise ValueError(f"endpoint = {GAIN!r} compares one arm with another, got {list(declared.arm)}")
        if len(self.scenarios) > 1:
            raise ValueError(f"endpoint = {GAIN!r} compares the curves of one scenario, got {list(self.scenarios)}")
        if self.axis is None or self.axis.reference is None:
            raise ValueError(f"endpoint = {GAIN!r} needs an axis with a reference: give both in [axis]")


@dataclass(frozen=True, kw_only=True)
class RunSpec:
    """One run of a study: an arm flies a scenario at a level of the axis with a seed."""

    scenario: str
    arm: str
    level: float | None
    """Level of the axis, such as a noise ratio; None without one."""
    run: Run
    key: str
    """`key_of` the run when the study began. A later version of the program may know more keys of a scenario and would
    compute another key, so a stored key is never computed again."""

    @property
    def short_key(self) -> str:
        """The first digits of the key, which people read and type."""
        return self.key[:SHORT]

    @property
    def seed(self) -> int:
        """Master seed of everything random in the run."""
        return self.run.seed

    @property
    def label(self) -> str:
        """The arm with its level."""
        return arm_label(self.arm, self.level)

    @property
    def title(self) -> str:
        """The run in words."""
        return f"scenario {self.scenario}, arm {self.label}, seed {self.seed}"


def arm_label(arm: str, level: float | None) -> str:
    """Return the name of an arm, with its level of the axis if it has one."""
    return arm if level is None else f"{arm} at {level:g}"


def load_study(name_or_path: str) -> Study:
    """Load a study by name or path, and make the paths of its scenarios absolute.

    Raises:
        ScenarioError: There is no such file, or a value in it is invalid.
    """
    path, study = load_alone(Study, "studies", name_or_path)
    scenarios = [str((path.parent / name).resolve()) if name.endswith(".toml") else name for name in study.scenarios]
    return study.model_copy(update={"scenarios": tuple(scenarios)})


def sources_of(run: Run) -> dict[str, str]:
    """Return the digests of the controller and the corrector of a run that are not ours, by their `module:factory`.

    Raises:
        ScenarioError: One of them has no source file.
    """
    scenario = run.scenario
    named = (scenario.mission.controller, registry.code_of(scenario.corrector.name))
    digests = {}
    for name in (name for name in named if name not in (None, DEFAULT_CONTROLLER)):
        if (file := source_of(name)) is None:
            raise ScenarioError(
                f"cannot find the module of {name!r}: put it into the current folder or one that PYTHONPATH names"
            )
        digests[name] = digest_of(file)[:DIGEST_DIGITS]
    return digests


def key_of(run: Run) -> str:
    """Return the SHA-256 of the canonical JSON of a run and of the user's code that it flies, in hexadecimal digits.

    Equal runs have equal keys, whatever their arms are called.
    """
    content = {"format": KEY_FORMAT, "run": run.model_dump(mode="json")}
    if sources := sources_of(run):
        content["sources"] = sources
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def expand(study: Study) -> list[RunSpec]:
    """List all runs of a study. Seeds vary slowest, so that a study that stops early has complete pairs.

    Raises:
        ScenarioError: A scenario does not exist, two have one name, or an arm sets an invalid value.
    """
    names = [load_run(scenario, 0, {}).scenario.name for scenario in study.scenarios]
    if len(set(names)) < len(names):
        raise ScenarioError(f"the scenarios of a study must have different names, got {', '.join(names)}")
    repeated = [
        (arm, level, _resolved(study, scenario, arm, level))
        for scenario, arm in product(study.scenarios, study.arms)
        for level in study.levels_of(arm)
    ]
    return [
        RunSpec(scenario=run.scenario.name, arm=arm.name, level=level, run=run, key=key_of(run))
        for seed in study.seeds.all
        for arm, level, run in ((arm, level, run.model_copy(update={"seed": seed})) for arm, level, run in repeated)
    ]


def _resolved(study: Study, scenario: str, arm: Arm, level: float | None) -> Run:
    """Return the run of an arm at a level that the seeds repeat."""
    at = {} if level is None else {study.axis_key: level}
    try:
        return load_run(scenario, 0, {**study.changes, **arm.settings, **at})
    except VoxDepthError as error:
        raise ScenarioError(f"the study {study.name!r}: arm {arm.name!r}: {error}") from error


def versions_of(specs: Iterable[RunSpec]) -> dict[str, str]:
    """Return `simulation_versions`, and the digests of the user's code that runs fly, see `sources_of`."""
    runs = {(s.run.scenario.mission.controller, s.run.scenario.corrector.name): s.run for s in specs}
    return simulation_versions() | {name: own for run in runs.values() for name, own in sources_of(run).items()}


def settings_that_left(study: Study, spec: RunSpec) -> dict[str, Any]:
    """Return the values that a study sets in a run, by dotted keys that scenarios no longer have.

    An earlier version flew by them. In this one they have no effect.
    """
    arm = next(arm for arm in study.arms if arm.name == spec.arm)
    level = {} if spec.level is None else {study.axis_key: spec.level}
    return dict(_absent({**study.changes, **arm.changes, **level}, spec.run.scenario.model_dump()))


def _absent(changes: Mapping[str, Any], table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield the dotted keys that a table lacks, with their values."""
    for key, value in changes.items():
        first, _, rest = key.partition(".")
        below = {rest: value} if rest else value
        if first not in table:
            yield key, value
        elif isinstance(below, dict) and isinstance(table[first], dict):
            yield from ((f"{first}.{name}", own) for name, own in _absent(below, table[first]))


def by_importance(study: Study, waiting: Iterable[RunSpec]) -> list[RunSpec]:
    """Return the waiting runs, those of the declared comparison first, so that a study that stops early has these.

    A gain is declared on whole curves and their reference, so that all runs of a seed go together.
    """
    declared = study.declared
    compared = () if declared is None or declared.endpoint == GAIN else declared.arms
    return sorted(waiting, key=lambda spec: spec.arm not in compared)


def identity(study: Study, specs: Sequence[RunSpec]) -> tuple[object, ...]:
    """Return what results depend on of a study with its resolved scenarios; it is the same wherever these lie."""
    design = study.model_dump(exclude={"scenarios", "description", "time_limit_s"})
    return design, [(spec.scenario, spec.arm, spec.level, spec.key) for spec in specs]
