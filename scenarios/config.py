"""Scenarios: everything that a run depends on, in one TOML file."""

from typing import Annotated, Any

import pydantic
from pydantic import Field

from sim.depth_noise import SensorModelName
from swarm.config import MissionSetup
from voxdepth import registry
from voxdepth.model import Model

from .files import Name, load


class Acceptance(Model):
    """What a scenario guarantees, and the depth with which it does."""

    depth: SensorModelName = "truth"
    corrector: str = "raw"
    width_px: int = Field(default=160, ge=32, le=4_096)
    height_px: int = Field(default=120, ge=32, le=4_096)
    decimate: int = Field(default=1, ge=1, le=8)
    """Factor by which captures are smaller than those images."""
    min_success_share: float = Field(default=0.9, ge=0, le=1)
    """Smallest share of seeds that end in success."""
    largest_means: dict[str, float] = Field(default_factory=dict)
    """Largest mean over the seeds of some metrics, by their names in `metrics.json`."""


class RecordingConfig(Model):
    """Contents of the Rerun recording."""

    image_every: int = Field(default=4, ge=1, le=1_000_000)
    """Every n-th capture of a drone is recorded with its images; everything else is recorded in full."""


class Scenario(MissionSetup):
    """Everything that a run depends on besides its seed."""

    name: Name
    description: str = ""
    corrector_latency_s: dict[str, Annotated[float, Field(ge=0)]] = Field(default_factory=dict)
    """Simulated time that a corrector takes for a frame, by its name, instead of its registered latency. It
    is a constant and never measured: results must not depend on the machine."""
    recording: RecordingConfig = RecordingConfig()
    acceptance: Acceptance = Acceptance()

    @pydantic.field_validator("corrector_latency_s")
    @classmethod
    def _require_known_names(cls, latency_s: dict[str, float]) -> dict[str, float]:
        for name in latency_s:
            registry.require_known(name)
        return latency_s

    @pydantic.model_validator(mode="after")
    def _require_latency(self) -> "Scenario":
        self.latency_of_corrector_s  # noqa: B018  # A missing latency is an error.
        return self

    @property
    def latency_of_corrector_s(self) -> float:
        """Simulated time that the corrector takes for a frame."""
        name = self.corrector.name
        override_s = self.corrector_latency_s.get(name)
        return registry.latency_s(name) if override_s is None else override_s

    @property
    def latency_s(self) -> float:
        """Simulated time from a capture until the controller knows its percept."""
        return self.mission.latency_s + self.latency_of_corrector_s


def images_of(width_px: int, height_px: int, decimate: int = 1) -> dict[str, int]:
    """Return the values of a scenario whose cameras match images of a size, by dotted key."""
    return {"rig.width_px": width_px, "rig.height_px": height_px, "rig.decimate": decimate}


class Run(Model):
    """A scenario with its seed: everything that is needed to repeat a run."""

    scenario: Scenario
    seed: int = Field(ge=0, lt=2**32)

    @property
    def title(self) -> str:
        """The run in one line."""
        rig, prior = self.scenario.rig, self.scenario.mission.pose_prior
        depth = f"noisy, theta {rig.noise.scale.theta:g}" if rig.depth == "noisy" else rig.depth
        corrector = registry.title(str(self.scenario.corrector))
        text = f"{self.scenario.name}, seed {self.seed}: depth {depth}, corrector {corrector}"
        return text if prior.kind == "none" else f"{text}, pose prior {prior.label}"


def load_run(name_or_path: str, seed: int | None, changes: dict[str, Any]) -> Run:
    """Return a run of a scenario, with the latency of its corrector written out to be repeatable; see `files.load`."""
    run = load(Run, "scenarios", name_or_path, seed, changes)
    scenario = run.scenario
    latency_s = {**scenario.corrector_latency_s, scenario.corrector.name: scenario.latency_of_corrector_s}
    return run.model_copy(update={"scenario": scenario.model_copy(update={"corrector_latency_s": latency_s})})


def load_setup(name_or_path: str) -> MissionSetup:
    """Return the parts of a scenario's missions, whose `mission.latency_s` includes the time of its corrector."""
    scenario = load_run(name_or_path, None, {}).scenario
    mission = scenario.mission.model_copy(update={"latency_s": scenario.latency_s})
    parts = {name: getattr(scenario, name) for name in MissionSetup.model_fields}
    return MissionSetup(**parts | {"mission": mission})
