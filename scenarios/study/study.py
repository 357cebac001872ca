"""What a study asks: its scenarios, the arms that are compared, its seeds, and the one comparison it was made for."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pydantic
from pydantic import Field

from sim.sensor_models import SensorModelName
from voxdepth.model import Model

from ..files import load_alone, shipped_names

FIRST_PILOT_SEED = 1000
"""Seeds from here on are for pilots: scenes and controllers may have been chosen by looking at them."""
OWN_KEYS = ("rig.depth", "rig.noise.scale.theta", "corrector", "rig.width_px", "rig.height_px")
"""Keys of a scenario that an arm sets by a field of its own."""
ALWAYS_SET = ("rig.depth", "corrector")
"""Those of them that every arm sets, so that they would have no effect in the changes of a study."""
NAME = r"^[A-Za-z0-9][A-Za-z0-9,._ -]*$"


class Seeds(Model):
    """Which seeds every cell of the matrix is flown with."""

    count: int = Field(ge=1)
    first: int = Field(0, ge=0)

    def listed(self, count: int | None = None) -> range:
        """The first of the seeds; all by default."""
        return range(self.first, self.first + (self.count if count is None else count))


class Arm(Model):
    """One way to fly a scenario: where depth comes from, who corrects it, and what else differs."""

    name: str = Field(pattern=NAME)
    depth: SensorModelName
    corrector: str
    theta: tuple[float, ...] = ()
    """Noise ratios of the sensor model `noisy`, one or a list; a cell of the matrix for each."""
    size: str | None = Field(None, pattern=r"^\d+x\d+$")
    """Image size, as in 160x120. Default: the scenario's."""
    seeds: int | None = Field(None, ge=1)
    """How many of the study's seeds, from the first on, so that pairs stay pairs. Default: all."""
    changes: Mapping[str, Any] = Field({}, strict=False)
    """Values of the scenario to set, by dotted key."""

    @pydantic.field_validator("theta", mode="before")
    @classmethod
    def _listed(cls, theta: Any) -> Any:
        return tuple(theta) if isinstance(theta, list | tuple) else (theta,)

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Arm":
        if (self.depth == "noisy") != bool(self.theta):
            raise ValueError(
                f"arm {self.name!r}: the sensor model 'noisy' needs theta, and no other has one; got depth "
                f"{self.depth!r} with theta {list(self.theta)}"
            )
        if len(set(self.theta)) < len(self.theta):
            raise ValueError(f"arm {self.name!r}: every theta may be named once, got {list(self.theta)}")
        if taken := [key for key in self.changes if key in OWN_KEYS]:
            raise ValueError(
                f"arm {self.name!r}: changes must not set {taken[0]}; use the arm's depth, theta, corrector or size"
            )
        return self

    @property
    def levels(self) -> tuple[float | None, ...]:
        """Its noise ratios; a single None for a sensor model that has none."""
        return self.theta or (None,)

    def changes_at(self, theta: float | None) -> dict[str, Any]:
        """All values of the scenario that the arm sets at one noise ratio, by dotted key."""
        changes = {**self.changes, "rig.depth": self.depth, "corrector": self.corrector}
        if theta is not None:
            changes["rig.noise.scale.theta"] = theta
        if self.size is not None:
            width, height = self.size.split("x")
            changes |= {"rig.width_px": int(width), "rig.height_px": int(height)}
        return changes


class Declared(Model):
    """The comparison that a study was made for, named before it was flown; it alone is not corrected for others."""

    arm: str
    against: str


class Study(Model):
    """A study, as its file says it."""

    name: str = Field(pattern=NAME)
    description: str
    scenarios: tuple[str, ...] = Field(strict=False, min_length=1)
    """Shipped scenarios by name, or paths of TOML files, relative to the study's file."""
    seeds: Seeds
    pilot: bool = False
    """A pilot has seeds from 1000 on, by which scenes and controllers may be chosen; all others have lower ones."""
    time_limit_s: float = Field(gt=0)
    """Wall-clock time after which a run is stopped and counts as an error."""
    changes: Mapping[str, Any] = Field({}, strict=False)
    """Values to set in every scenario for every arm, by dotted key."""
    declared: Declared | None = None
    arms: tuple[Arm, ...] = Field(strict=False, min_length=1)

    @pydantic.model_validator(mode="after")
    def _check(self) -> "Study":
        _require_unique("scenario", self.scenarios)
        _require_unique("arm", [arm.name for arm in self.arms])
        if taken := [key for key in self.changes if key in ALWAYS_SET]:
            raise ValueError(f"changes must not set {taken[0]}, for every arm sets it: name it in the arms")
        self._check_seeds()
        self._check_declared()
        return self

    def _check_seeds(self) -> None:
        first, last = self.seeds.first, self.seeds.first + self.seeds.count - 1
        if not self.pilot and last >= FIRST_PILOT_SEED:
            raise ValueError(
                f"seeds {first} to {last} reach into those of pilots, which are {FIRST_PILOT_SEED} and up: take lower "
                "ones, or say pilot = true"
            )
        if self.pilot and first < FIRST_PILOT_SEED:
            raise ValueError(f"a pilot's seeds are {FIRST_PILOT_SEED} and up, got {first}: set seeds.first")
        for arm in self.arms:
            if arm.seeds is not None and arm.seeds > self.seeds.count:
                raise ValueError(f"arm {arm.name!r} has {arm.seeds} seeds, the study only {self.seeds.count}")

    def _check_declared(self) -> None:
        if self.declared is None:
            return
        arms = {arm.name: arm for arm in self.arms}
        for name in (self.declared.arm, self.declared.against):
            if name not in arms:
                raise ValueError(f"the declared comparison names no arm of the study: {name!r}; it has {list(arms)}")
            if len(arms[name].levels) > 1:
                raise ValueError(
                    f"a declared comparison needs arms of one theta, {name!r} has {len(arms[name].levels)}"
                )
        if self.declared.arm == self.declared.against:
            raise ValueError(f"the declared comparison must name two arms, got {self.declared.arm!r} twice")


def study_names() -> list[str]:
    """Names of the shipped studies."""
    return shipped_names("studies")


def load_study(name_or_path: str) -> Study:
    """A study by name or path, with the paths of its scenarios made independent of where its file is.

    Raises:
        ScenarioError: There is no such file, or a value in it is impossible.
    """
    path, study = load_alone(Study, "studies", name_or_path)
    scenarios = tuple(_from(path.parent, scenario) for scenario in study.scenarios)
    return study.model_copy(update={"scenarios": scenarios})


def _from(folder: Path, scenario: str) -> str:
    return str((folder / scenario).resolve()) if scenario.endswith(".toml") else scenario


def _require_unique(what: str, names: Any) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise ValueError(f"every {what} may be named once, got {name!r} more than once")
