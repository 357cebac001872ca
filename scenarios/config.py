"""Scenarios: everything a run depends on, in one TOML file."""

import tomllib
from pathlib import Path
from typing import Any, Literal

import pydantic
import tomli_w
from pydantic import Field

from sim.drone import AirframeConfig
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from sim.tiers import DepthTierName
from swarm.mission import MissionConfig
from voxdepth.model import Model
from voxdepth.registry import CORRECTOR_NAMES

from .errors import ScenarioError

DATA = Path(__file__).parent / "data"


class Acceptance(Model):
    """What a scenario promises, and with which depth."""

    depth: DepthTierName = "truth"
    corrector: str = "raw"
    width_px: int = Field(160, ge=32)
    height_px: int = Field(120, ge=32)
    min_success_share: float = Field(0.9, ge=0, le=1)
    """Least share of seeds that end in success."""


class RecordingConfig(Model):
    """What the recording keeps."""

    image_every: int = Field(4, ge=1)
    """Of how many captures of a drone one is kept with its images; everything else is kept in full."""


class Scenario(Model):
    """One experiment, but for its seed."""

    name: str
    description: str
    scene: AnyScene = CitySpec()
    mission: MissionConfig = MissionConfig()
    rig: RigConfig = RigConfig()
    airframe: AirframeConfig = AirframeConfig()
    corrector: str = "paper"
    """Name of the depth corrector of every drone."""
    renderer: Literal["raycast", "tiny", "egl"] = "raycast"
    recording: RecordingConfig = RecordingConfig()
    acceptance: Acceptance = Acceptance()

    @pydantic.field_validator("corrector")
    @classmethod
    def _known(cls, name: str) -> str:
        if name not in CORRECTOR_NAMES:
            raise ValueError(f"there is no corrector {name!r}; choose one of: {', '.join(CORRECTOR_NAMES)}")
        return name


class Run(Model):
    """A scenario with its seed: all that is needed to repeat a run."""

    scenario: Scenario
    seed: int = Field(ge=0)


def scenario_names() -> list[str]:
    """Names of the shipped scenarios."""
    return sorted(path.stem for path in DATA.glob("*.toml"))


def load_run(name_or_path: str, seed: int | None, changes: dict[str, Any]) -> Run:
    """A shipped scenario by name, a TOML file of a scenario, or the `config.toml` of an earlier run.

    Args:
        name_or_path: Which one.
        seed: Master seed; None takes that of an earlier run, or 0.
        changes: Values to set, by dotted key, as in `{"mission.drones": 4}`.

    Raises:
        ScenarioError: There is no such scenario, or a value in it is impossible.
    """
    path, text = _read(name_or_path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{path} is not valid TOML: {error}") from error
    if "scenario" not in data:
        data = {"scenario": data, "seed": 0}
    for key, value in changes.items():
        _set(data["scenario"], key, value)
    if seed is not None:
        data["seed"] = seed
    try:
        return Run.model_validate(data)
    except pydantic.ValidationError as error:
        raise ScenarioError(f"{path}: {_first_problem(error)}") from error


def to_toml(run: Run) -> str:
    """The resolved configuration as text that `load_run` reads."""
    return tomli_w.dumps(run.model_dump(mode="json", exclude_none=True))


def _read(name_or_path: str) -> tuple[Path, str]:
    path = Path(name_or_path)
    if path.suffix != ".toml":
        if name_or_path not in scenario_names():
            raise ScenarioError(
                f"there is no scenario {name_or_path!r}; choose one of: {', '.join(scenario_names())}, "
                "or give the path of a .toml file"
            )
        path = DATA / f"{name_or_path}.toml"
    try:
        return path, path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"cannot read the scenario {path}: {error}") from error


def _set(data: dict[str, Any], key: str, value: Any) -> None:
    *tables, last = key.split(".")
    for table in tables:
        data = data.setdefault(table, {})
    data[last] = value


def _first_problem(error: pydantic.ValidationError) -> str:
    """The first of the problems in one line, and how many more there are."""
    first, *others = error.errors()
    where = ".".join(str(part) for part in first["loc"] if part != "scenario") or "the scenario"
    if first["type"] == "extra_forbidden":
        text = f"unknown key {where!r}"
    elif first["type"] == "missing":
        text = f"the key {where!r} is missing"
    else:
        got = first["input"]
        shown = f", got {got!r}" if isinstance(got, str | int | float | bool | list) else ""
        text = f"{where}: {first['msg'].removeprefix('Value error, ')}{shown}"
    return text + (f" (and {len(others)} more problems)" if others else "")
