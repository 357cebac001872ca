"""Power consumption of the methods, if the machine has an energy counter; otherwise nothing is measured."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, Protocol

from matplotlib.axes import Axes

from voxdepth.registry import create_corrector
from voxdepth.types import DepthCorrector

from ..benchmark.frames import FrameLoop
from ..errors import ScenarioError
from ..results.figure import grouped_bars, label_axes, panels
from ..results.table import Column, Table
from .experiment import Claim, Experiment, ExperimentContext, Findings
from .frame_rate import close_corrector
from .quality import METHODS

IDLE, WORKING = "idle", ("VD", "RS", "GS")
NOT_MEASURED = "not measured"
WARM_UP_FRAMES = 16
CLAIM = "VD takes 2.9 % less power than GS and 28.8 % less than DS"
REMEDY = (
    "it takes `pip install voxdepth[power]`, an Intel or AMD processor whose energy counters Linux shows below "
    "/sys/class/powercap/intel-rapl (virtual machines seldom do), and permission to read them, as by "
    "`sudo chmod a+r /sys/class/powercap/intel-rapl*/energy_uj`"
)
COLUMNS = (
    "sequence", "method", Column("power", "W"), Column("above idle", "W"), Column("energy per frame", "J", ".4f"),
    "n frames", Column("time", "s", ".1f"),
)  # fmt: skip


class NoMeterError(ScenarioError):
    """Energy cannot be measured here; the message says why."""


class Meter(Protocol):
    """An energy counter."""

    name: str
    """What it measures, and how."""

    def energy_j(self) -> float:
        """Energy since an arbitrary moment [J]; only differences are meaningful."""
        ...


class RaplMeter:
    """The energy of all processor packages by the library zeus, which includes that of other processes.

    Args:
        cpus: The result of `zeus.device.cpu.get_cpus`.
    """

    def __init__(self, cpus: Any) -> None:
        self._cpus = cpus
        self.name = f"RAPL through zeus, {len(cpus)} processor package(s)"

    def energy_j(self) -> float:
        """See `Meter`."""
        used = [self._cpus.get_total_energy_consumption(index) for index in range(len(self._cpus))]
        return sum(float(one.cpu_mj) for one in used) / 1000


def find_meter() -> Meter:
    """The energy counter of this machine.

    Raises:
        NoMeterError: The machine has none that this process can read.
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


@dataclass(frozen=True, kw_only=True)
class Consumption:
    """The energy of continuous work."""

    frames: int
    time_s: float
    energy_j: float

    @property
    def power_w(self) -> float:
        """Mean power of everything that the meter counts."""
        return self.energy_j / self.time_s


Measured = Mapping[str, Consumption]
"""Consumption by method."""


def measure_power(
    context: ExperimentContext, *, find: Callable[[], Meter] = find_meter, seconds: float = 10.0
) -> Findings:
    """Measure the energy of each method during continuous work, and of the idle machine."""
    try:
        meter = find()
    except NoMeterError as error:
        return _not_measured(str(error))
    measured = {name: _measure(context, name, meter, seconds) for name in context.sequences}
    rows = [
        (name, method, one.power_w, one.power_w - by_method[IDLE].power_w,
         one.energy_j / one.frames if one.frames else None, one.frames, one.time_s)
        for name, by_method in measured.items()
        for method, one in by_method.items()
    ]  # fmt: skip
    return Findings(
        tables=(Table.of(f"Power by {meter.name}", COLUMNS, rows),),
        claims=tuple(_claim(name, by_method) for name, by_method in measured.items()),
        notes=(
            f"{context.frames} images in memory, played forwards and backwards for {seconds:g} s, as fast as "
            "each method can: a faster method corrects more frames for the same power. OpenCV on one thread.",
            "The meter counts the whole machine: let nothing else run. DeepSmooth is not built here.",
        ),
        figure=panels(f"Power, n = {seconds:g} s of each method", [partial(_draw, measured)]),
    )


def _measure(context: ExperimentContext, name: str, meter: Meter, seconds: float) -> Measured:
    loop = context.frame_loop(name, context.frames)
    context.report(f"measuring the idle machine for {seconds:g} s")
    start_j, start_s = meter.energy_j(), time.perf_counter()
    time.sleep(seconds)
    time_s = time.perf_counter() - start_s
    measured = {IDLE: Consumption(frames=0, time_s=time_s, energy_j=meter.energy_j() - start_j)}
    for method in WORKING:
        context.report(f"{name}, {method} for {seconds:g} s")
        measured[method] = _work(meter, create_corrector(METHODS[method], loop.intrinsics), loop, seconds)
    return measured


def _work(meter: Meter, corrector: DepthCorrector, loop: FrameLoop, seconds: float) -> Consumption:
    """Correct as many frames as possible within the time, after a warm-up."""
    frames = loop.play(2**31)
    for frame in islice(frames, WARM_UP_FRAMES):
        corrector.process(frame)
    start_j, start_s = meter.energy_j(), time.perf_counter()
    done, time_s = 0, 0.0
    while time_s < seconds:
        corrector.process(next(frames))
        done += 1
        time_s = time.perf_counter() - start_s
    energy_j = meter.energy_j() - start_j
    close_corrector(corrector)
    return Consumption(frames=done, time_s=time_s, energy_j=energy_j)


def _not_measured(reason: str) -> Findings:
    """Findings without any number."""
    rows = [("-", method, *(NOT_MEASURED,) * 3, 0, 0.0) for method in (IDLE, *WORKING)]

    def draw(axes: Axes) -> None:
        axes.text(0.5, 0.5, NOT_MEASURED, ha="center", va="center", fontsize=16, transform=axes.transAxes)
        label_axes(axes, reason[:80], "method", "power [W]")

    return Findings(
        tables=(Table.of("Power: not measured", COLUMNS, rows),),
        claims=(Claim(paper=CLAIM, found=NOT_MEASURED, holds=None),),
        notes=(f"Power was not measured: {reason}.", f"To measure it: {REMEDY}."),
        figure=panels("Power: not measured, n = 0", [draw]),
    )


def _claim(name: str, measured: Measured) -> Claim:
    less = 100 * (1 - measured["VD"].power_w / measured["GS"].power_w)
    return Claim(paper=CLAIM, found=f"{name}: VD takes {less:.1f} % less power than GS", holds=less > 0)


def _draw(measured: Mapping[str, Measured], axes: Axes) -> None:
    label_axes(axes, "mean during continuous work", "method", "power [W]")
    series = {name: [one.power_w for one in by_method.values()] for name, by_method in measured.items()}
    grouped_bars(axes, (IDLE, *WORKING), series)


POWER = Experiment(
    "power", "How much power does each method take (Fig. power)?",
    measure_power, ("sim-LN",), frames=16, width_px=640, min_frames=2,
)  # fmt: skip
