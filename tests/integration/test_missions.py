"""Whole flights."""

from pathlib import Path
from threading import Event
from typing import Any

import numpy as np
import pytest

from scenarios.acceptance import check_acceptance
from scenarios.config import Run, load_run
from scenarios.files import DATA, shipped_names
from scenarios.flight import fly, flying
from sim.types import Capture, Contact
from swarm.perception import Perception
from swarm.recorder import Recorder
from swarm.types import Outcome, Percept
from voxdepth.types import CorrectedDepth


def to(x_m: float, *, y_m: float = 0.0) -> list[dict[str, list[float]]]:
    """One route along x."""
    return [{"start_m": [-8.0, y_m, 6.0], "goal_m": [x_m, y_m, 6.0]}]


def short(**changes: Any) -> Run:
    """A small, quick mission: three drones towards a goal before the first towers."""
    values: dict[str, Any] = {
        "mission.drones": 3,
        "mission.routes": to(-2.0),
        "mission.duration_s": 12.0,
        "rig.width_px": 96,
        "rig.height_px": 64,
        "rig.decimate": 1,
        "rig.depth": "truth",
        "corrector": "raw",
    }
    return load_run("city", 0, values | changes)


@pytest.mark.parametrize(
    ("depth", "corrector"),
    [
        ("stereo", "temporal"),
        ("noisy", "raw"),
        *(pytest.param(depth, "voxdepth", marks=pytest.mark.slow) for depth in ("truth", "stereo")),
    ],
)
def test_the_same_seed_gives_the_same_flight_with_any_number_of_threads(depth: str, corrector: str) -> None:
    changes = {"rig.depth": depth, "mission.duration_s": 1.5, "corrector": corrector}
    if depth == "noisy":
        changes["rig.noise.scale.theta"] = 0.5
    run = short(**changes)
    first, second = (fly(run, threads=n).result for n in (1, 3))
    assert first.outcome is second.outcome
    assert first.metrics == second.metrics
    if depth == "noisy":
        assert fly(run.model_copy(update={"seed": 1})).result.metrics != first.metrics
    for a, b in zip(first.trajectories, second.trajectories, strict=True):
        np.testing.assert_array_equal(a.position_m, b.position_m)


class Spy(Recorder):
    """Keeps the names of the calls, and says when drones have decided."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.decided = Event()

    def capture(self, step: int, capture: Capture, corrected: CorrectedDepth) -> None:
        self.calls.append(f"capture {capture.drone} at {step}")

    def tick(self, step: int, time_s: float, states: object, decisions: object) -> None:
        self.decided.set()

    def contact(self, step: int, contact: Contact) -> None:
        self.calls.append("contact")

    def outcome(self, step: int, time_s: float, outcome: Outcome) -> None:
        self.calls.append("outcome")


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Spy:
    """A recorder of a flight in which no image is processed before the drones have decided."""
    recorder, see = Spy(), Perception.see

    def see_late(self: Perception, capture: Capture) -> Percept:
        assert recorder.decided.wait(20), "the drones wait for images that they do not know yet"
        return see(self, capture)

    monkeypatch.setattr(Perception, "see", see_late)
    return recorder


OF_THE_FIRST_IMAGES = [f"capture {drone} at 0" for drone in range(3)]


def test_drones_decide_and_fly_while_their_images_are_processed(spy: Spy) -> None:
    with flying(short(), spy, recorded=False, threads=2) as mission:
        mission.tick(wait=False)
        assert spy.calls == []
        mission.tick(wait=False)
        assert spy.calls == OF_THE_FIRST_IMAGES
        mission.tick(wait=False)
        mission.interrupt()
    assert spy.calls == [*OF_THE_FIRST_IMAGES, *(f"capture {drone} at 24" for drone in range(3)), "outcome"]


def test_a_recorder_receives_images_before_a_contact(spy: Spy, monkeypatch: pytest.MonkeyPatch) -> None:
    hit = Contact(time_s=0.0, drone=1, other="tower", kind="building", speed_m_s=1.0)
    with flying(short(), spy, recorded=False, threads=2) as mission:
        monkeypatch.setattr(mission.world, "step", lambda: [hit])
        mission.tick(wait=False)
    assert spy.calls[:4] == [*OF_THE_FIRST_IMAGES, "contact"]


def test_a_drone_that_sees_late_knows_how_far_it_has_come_since() -> None:
    across = {"mission.routes": to(12.0, y_m=2.6), "mission.drones": 1}
    result = fly(short(**across, **{"mission.latency_s": 1.0, "mission.duration_s": 12.0})).result
    assert not result.contacts


def test_dropped_frames_are_counted() -> None:
    result = fly(short(**{"mission.latency_s": 0.25, "mission.duration_s": 2.0})).result
    assert result.metrics["dropped_frames"] == 3 * 13


CITY_IN_OTHER_IMAGES = {"dim", "exposure", "glass", "weak"}
"""Scenarios that true depth shows as `city`, by which their acceptance is flown; `make acceptance` flies them, too."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in shipped_names("scenarios") if name not in CITY_IN_OTHER_IMAGES])
def test_shipped_scenarios_keep_their_promise(name: str, tmp_path: Path) -> None:
    if name == "paper":  # A third of its way, because its stereo images take long to match.
        text = (DATA / "scenarios" / "paper.toml").read_text()
        name = str(tmp_path / "paper.toml")
        Path(name).write_text(text.replace("goal_m = [28.0,", "goal_m = [6.0,"))
    assert [promise for promise in check_acceptance(name, [0], lambda *_: None) if not promise.kept] == []
