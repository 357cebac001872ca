"""A run that is requested to end writes its files first, whenever that is."""

import json
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

from scenarios import runner
from scenarios.config import images_of, load_run
from scenarios.flight import fly, flying, ticked
from swarm.mission import Mission
from swarm.recorder import Recorder
from voxdepth.baselines.single_frame import Raw
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.interrupts import ENDING, kept_back

QUICK = {"mission.drones": 1, "mission.duration_s": 0.5, **images_of(32, 32), "rig.depth": "truth", "corrector": "raw"}


@pytest.fixture(autouse=True)
def _handled() -> Iterator[None]:
    """Let all signals raise `KeyboardInterrupt`, as the command line does."""
    before = {number: signal.signal(number, signal.default_int_handler) for number in ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


def send(number: int) -> None:
    signal.raise_signal(number)


@pytest.mark.parametrize("number", ENDING)
def test_the_first_signal_waits_for_a_moment_without_harm(number: int) -> None:
    before = signal.getsignal(number)
    with kept_back() as hand_on:
        hand_on()
        send(number)
        with pytest.raises(KeyboardInterrupt):
            hand_on()
    assert signal.getsignal(number) is before


def test_the_second_signal_ends_the_block() -> None:
    done = []
    with pytest.raises(KeyboardInterrupt), kept_back():
        send(signal.SIGINT)
        done.append(1)
        send(signal.SIGINT)
        done.append(2)
    assert done == [1]


def test_a_thread_keeps_nothing_back() -> None:
    before = signal.getsignal(signal.SIGINT)
    inside: list[Any] = []

    def enter() -> None:
        with kept_back() as hand_on:
            inside.append(signal.getsignal(signal.SIGINT))
            hand_on()

    thread = threading.Thread(target=enter)
    thread.start()
    thread.join()
    assert inside == [before]


def test_the_correctors_of_a_flight_are_closed_however_it_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    closed = []

    class WithDevice(Raw):
        def close(self) -> None:
            closed.append(self)

    monkeypatch.setattr(CorrectorSpec, "create", lambda spec, camera: WithDevice(camera))
    with pytest.raises(ZeroDivisionError), flying(load_run("city", 0, QUICK), Recorder(), recorded=False):
        raise ZeroDivisionError
    assert len(closed) == 1


def test_an_interrupted_flight_is_no_result(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Mission, "tick", lambda mission, wait=True: send(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        fly(load_run("city", 0, QUICK))


def test_an_interrupt_while_a_flight_ends_is_not_lost() -> None:
    class Ends:
        outcome: str | None = None

        def tick(self, *, wait: bool) -> None:
            self.outcome = "success"
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ticked(Ends())


@pytest.mark.parametrize("file", ["config.toml", "metrics.json"])
def test_a_run_that_is_asked_to_end_while_it_writes_has_all_its_files(
    file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = runner.write

    def write_and_ask(path: Path, content: bytes) -> None:
        if path.name == file:
            send(signal.SIGINT)
        write(path, content)

    monkeypatch.setattr(runner, "write", write_and_ask)
    monkeypatch.setattr(runner, "flight_figure", lambda *_: Figure())
    folder = runner.fly_and_write(load_run("city", 0, QUICK), tmp_path, record=True).folder
    files = {path.name for path in folder.iterdir()}
    assert files == {"config.toml", "metrics.json", "trajectories", "flight.png", "summary.html", "run.rrd"}
    outcome = json.loads((folder / "metrics.json").read_text())["outcome"]
    assert outcome == ("interrupted" if file == "config.toml" else "timeout")
