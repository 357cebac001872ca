"""Scenarios: everything a run depends on, in one TOML file."""

from typing import Annotated, Any

import pydantic
from pydantic import Field

from sim.drone import AirframeConfig
from sim.render import RendererName
from sim.scenes import AnyScene, CitySpec
from sim.sensor import RigConfig
from sim.sensor_models import SensorModelName
from swarm.task import MissionConfig
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.model import Model
from voxdepth.registry import DEFAULT, require_known

from .files import load, shipped_names


class Acceptance(Model):
    """What a scenario promises, and with which depth."""

    depth: SensorModelName = "truth"
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
    corrector: CorrectorSpec = CorrectorSpec(name=DEFAULT)
    """Depth corrector of every drone: its name, or a table with `name` and `config`."""
    corrector_latency_s: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """Simulated time that a corrector takes for a frame, by its name; those that are not named take none. Frozen here,
    and never the wall clock: results must not depend on the machine."""
    renderer: RendererName = "raster"
    recording: RecordingConfig = RecordingConfig()
    acceptance: Acceptance = Acceptance()

    @pydantic.field_validator("corrector_latency_s")
    @classmethod
    def _all_known(cls, latency_s: dict[str, float]) -> dict[str, float]:
        for name in latency_s:
            require_known(name)
        return latency_s

    @property
    def latency_s(self) -> float:
        """Simulated time from a capture to the moment its result can be flown by."""
        return self.mission.latency_s + self.corrector_latency_s.get(self.corrector.name, 0.0)


class Run(Model):
    """A scenario with its seed: all that is needed to repeat a run."""

    scenario: Scenario
    seed: int = Field(ge=0, lt=2**32)


def scenario_names() -> list[str]:
    """Names of the shipped scenarios."""
    return shipped_names("scenarios")


def load_run(name_or_path: str, seed: int | None, changes: dict[str, Any]) -> Run:
    """A run of a scenario: see `files.load`."""
    return load(Run, "scenarios", name_or_path, seed, changes)
