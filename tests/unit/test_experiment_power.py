"""Power: measured by whatever meter there is, and never made up."""

import sys
import time
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from scenarios.experiments.power import NOT_MEASURED, Meter, NoMeterError, find_meter, measure_power
from tests.experiment_context import small_context

POWER_W = 7.0


def steady() -> Meter:
    """The meter of a machine that always takes as much."""
    return Meter(name="a steady meter", energy_j=lambda: POWER_W * time.perf_counter())


class BrokenZeusError(Exception):
    """Stands for zeus's own."""


def nothing() -> Meter:
    raise NoMeterError("this is a test")


def give_zeus(monkeypatch: pytest.MonkeyPatch, get_cpus: Any) -> None:
    """Install a stand-in for the library."""
    for name in ("zeus", "zeus.device", "zeus.device.cpu", "zeus.exception"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setattr(sys.modules["zeus.device.cpu"], "get_cpus", get_cpus, raising=False)
    monkeypatch.setattr(sys.modules["zeus.exception"], "ZeusBaseError", BrokenZeusError, raising=False)


class TwoPackages:
    """Two processors that used 1.5 J and 2 J."""

    def __len__(self) -> int:
        return 2

    def get_total_energy_consumption(self, index: int) -> SimpleNamespace:
        return SimpleNamespace(cpu_mj=(1500.0, 2000.0)[index], dram_mj=None)


def test_without_a_meter_it_says_so_and_holds_no_number(tmp_path: Path) -> None:
    findings = measure_power(small_context(tmp_path, 2), find=nothing)
    (table,) = findings.tables
    for column in ("power", "above idle", "energy per frame"):
        assert set(table.column(column)) == {NOT_MEASURED}
    assert "this is a test" in findings.notes[0]
    assert "pip install voxdepth[power]" in findings.notes[1]
    assert [claim.holds for claim in findings.claims] == [None]
    assert not list(tmp_path.iterdir()), "nothing is recorded for that"


def test_a_meter_is_read_around_the_work(tmp_path: Path) -> None:
    (table,) = measure_power(small_context(tmp_path, 2), find=steady, seconds=0.05).tables
    assert table.column("method") == ["idle", "VD", "RS", "GS"]
    assert table.column("power") == pytest.approx([POWER_W] * 4, rel=0.05)
    frames, energies = table.column("n frames"), table.column("energy per frame")
    assert frames[0] == 0 and energies[0] is None
    for n, energy_j, time_s in list(zip(frames, energies, table.column("time"), strict=True))[1:]:
        assert isinstance(n, int) and n > 0
        assert isinstance(time_s, float) and time_s >= 0.05
        assert energy_j == pytest.approx(POWER_W * time_s / n, rel=0.05)


def test_the_packages_that_zeus_reads_are_added_in_joules(monkeypatch: pytest.MonkeyPatch) -> None:
    give_zeus(monkeypatch, TwoPackages)
    assert find_meter().energy_j() == 3.5


@pytest.mark.parametrize("error", [BrokenZeusError("no counter"), PermissionError("no leave")])
def test_counters_that_cannot_be_read_are_no_meter(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def get_cpus() -> None:
        raise error

    give_zeus(monkeypatch, get_cpus)
    with pytest.raises(NoMeterError, match=str(error)):
        find_meter()


def test_no_zeus_is_no_meter(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zeus", None)
    monkeypatch.delitem(sys.modules, "zeus.device.cpu", raising=False)
    with pytest.raises(NoMeterError, match="not installed"):
        find_meter()
