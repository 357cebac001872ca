"""Power consumption of the methods, if the machine has an energy counter; otherwise nothing is measured."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any

import pandas as pd
from matplotlib.axes import Axes

from voxdepth.registry import create_corrector
from voxdepth.tools.benchmark.frames import FrameLoop
from voxdepth.tools.table import Column, Table, Value
from voxdepth.types import DepthCorrector

from ..errors import ScenarioError
from ..results.figure import grouped_bars, label_axes, panels
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


@dataclass(frozen=True, kw_only=True)
class Meter:
    """An energy counter."""

    name: str
    """What it measures, and how."""
    energy_j: Callable[[], float]
    """Reads the energy since an arbitrary moment [J]; only differences are meaningful."""


def find_meter() -> Meter:
    """The energy counters of all processor packages together, which count other processes, too.

    Raises:
        NoMeterError: The machine has none that this process can read.
    """
    try:
        from zeus.device.cpu import get_cpus
        from zeus.exception import ZeusBaseError
    except ImportError as error:
        raise NoMeterError("the library zeus is not installed") from error
    try:
        cpus = get_cpus()
        meter = Meter(name=f"RAPL through zeus, {len(cpus)} processor package(s)", energy_j=partial(_rapl_j, cpus))
        meter.energy_j()
    except (ZeusBaseError, OSError) as error:
        raise NoMeterError(f"zeus finds no energy counter that it can read ({error})") from error
    return meter


def _rapl_j(cpus: Any) -> float:
    """Energy of all packages of the result of `zeus.device.cpu.get_cpus` [J]."""
    return sum(float(cpus.get_total_energy_consumption(index).cpu_mj) for index in range(len(cpus))) / 1000


def measure_power(
    context: ExperimentContext, *, find: Callable[[], Meter] = find_meter, seconds: float = 10.0
) -> Findings:
    """Measure the energy of each method during continuous work, and of the idle machine."""
    try:
        meter = find()
    except NoMeterError as error:
        return _not_measured(str(error))
    rows = [row for name in context.sequences for row in _measure(context, name, meter, seconds)]
    table = Table.of(f"Power by {meter.name}", COLUMNS, rows)
    powers_w = table.pivot("method", "sequence", "power")
    return Findings(
        tables=(table,),
        claims=tuple(_claim(name, powers_w[name]) for name in context.sequences),
        notes=(
            f"{context.frames} images in memory, played forwards and backwards for {seconds:g} s, as fast as "
            "each method can: a faster method corrects more frames for the same power. OpenCV on one thread.",
            "The meter counts the whole machine: let nothing else run. DeepSmooth is not measured.",
        ),
        figure=panels(f"Power, n = {seconds:g} s of each method", [partial(_draw, powers_w)]),
    )


def _measure(context: ExperimentContext, name: str, meter: Meter, seconds: float) -> Iterator[Sequence[Value]]:
    """Yield a row for the idle machine and for each method."""
    loop = context.frame_loop(name, context.frames)
    context.report(f"measuring the idle machine for {seconds:g} s")
    start_j, start_s = meter.energy_j(), time.perf_counter()
    time.sleep(seconds)
    time_s = time.perf_counter() - start_s
    idle_w = (meter.energy_j() - start_j) / time_s
    yield name, IDLE, idle_w, 0.0, None, 0, time_s
    for method in WORKING:
        context.report(f"{name}, {method} for {seconds:g} s")
        frames, energy_j, time_s = _work(meter, create_corrector(METHODS[method], loop.intrinsics), loop, seconds)
        yield name, method, energy_j / time_s, energy_j / time_s - idle_w, energy_j / frames, frames, time_s


def _work(meter: Meter, corrector: DepthCorrector, loop: FrameLoop, seconds: float) -> tuple[int, float, float]:
    """Correct as many frames as possible within the time, after a warm-up: their number, energy [J] and time [s]."""
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
    return done, energy_j, time_s


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


def _claim(name: str, powers_w: pd.Series) -> Claim:
    less = float(100 * (1 - powers_w["VD"] / powers_w["GS"]))
    return Claim(paper=CLAIM, found=f"{name}: VD takes {less:.1f} % less power than GS", holds=less > 0)


def _draw(powers_w: pd.DataFrame, axes: Axes) -> None:
    label_axes(axes, "mean during continuous work", "method", "power [W]")
    grouped_bars(axes, list(powers_w.index), powers_w.to_dict("list"))


POWER = Experiment(
    "power", "How much power does each method take (Fig. power)?",
    measure_power, ("sim-LN",), frames=16, width_px=640, min_frames=2,
)  # fmt: skip
