"""Energy that the machine used, where something can measure it."""

from collections.abc import Callable
from typing import Any, Protocol

from ..errors import ScenarioError

REMEDY = (
    "it takes `pip install voxdepth[power]`, an Intel or AMD processor whose energy counters Linux shows below "
    "/sys/class/powercap/intel-rapl (virtual machines seldom do), and leave to read them, as by "
    "`sudo chmod a+r /sys/class/powercap/intel-rapl*/energy_uj`"
)


class NoMeterError(ScenarioError):
    """Energy cannot be measured here; the message says why."""


class Meter(Protocol):
    """Counts energy."""

    name: str
    """What is measured, and by what."""

    def energy_j(self) -> float:
        """Energy since some moment [J]: only differences mean anything."""
        ...


FindMeter = Callable[[], Meter]


class RaplMeter:
    """The energy of all processor packages, by the library zeus: of the whole machine, not of this process alone."""

    def __init__(self, cpus: Any) -> None:
        """A meter.

        Args:
            cpus: What `zeus.device.cpu.get_cpus` gives.
        """
        self._cpus = cpus
        self.name = f"RAPL through zeus, {len(cpus)} processor package(s)"

    def energy_j(self) -> float:
        """See `Meter`."""
        used = [self._cpus.get_total_energy_consumption(index) for index in range(len(self._cpus))]
        return sum(float(one.cpu_mj) for one in used) / 1000


def find_meter() -> Meter:
    """The meter of this machine.

    Raises:
        NoMeterError: There is none that can be read.
    """
    try:
        from zeus.device.cpu import get_cpus
        from zeus.exception import ZeusBaseError
    except ImportError as error:
        raise NoMeterError("the library zeus is not installed") from error
    try:
        meter = RaplMeter(get_cpus())
        meter.energy_j()
    except (ZeusBaseError, OSError) as error:
        raise NoMeterError(f"zeus finds no energy counter that it can read ({error})") from error
    return meter
