"""Power consumption of the methods, where there is a meter; otherwise it says that nothing was measured."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from voxdepth.registry import create_corrector
from voxdepth.types import DepthCorrector

from ..benchmark.frames import FrameLoop
from .drawing import labelled, panels
from .meters import REMEDY, FindMeter, Meter, NoMeterError, find_meter
from .quality import METHODS
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

IDLE, WORKING = "idle", ("VD", "RS", "GS")
NOT_MEASURED = "not measured"
WARM_UP_FRAMES = 16
CLAIM = "VD takes 2.9 % less power than GS and 28.8 % less than DS"


@dataclass(frozen=True, kw_only=True)
class Consumption:
    """What a method used while it worked without a pause."""

    frames: int
    time_s: float
    energy_j: float

    @property
    def power_w(self) -> float:
        """Mean power of the whole machine, as far as it is metered."""
        return self.energy_j / self.time_s


class Power:
    """Every method works for some seconds while the meter counts; so does a machine that does nothing."""

    name = "power"
    question = "How much power does each method take (Fig. power)?"
    scope = Scope(sequences=("sim-LN",), frames=16, width_px=640, least_frames=2)

    def __init__(self, find: FindMeter = find_meter, seconds: float = 10.0) -> None:
        self._find, self._seconds = find, seconds

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        try:
            meter = self._find()
        except NoMeterError as error:
            return _unmeasured(str(error))
        found = {name: self._measure(stage, name, meter) for name in stage.sequences}
        rows = [
            (name, method, one.power_w, one.power_w - of_one[IDLE].power_w,
             one.energy_j / one.frames if one.frames else None, one.frames, one.time_s)
            for name, of_one in found.items()
            for method, one in of_one.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of(f"Power by {meter.name}", _columns(), rows),),
            claims=tuple(_claim(name, of_one) for name, of_one in found.items()),
            notes=(
                f"{stage.frames} images in memory, played forwards and backwards for {self._seconds:g} s, as fast as "
                "each method can: whoever is faster corrects more frames for the same power. OpenCV on one thread.",
                "The meter counts the whole machine: let nothing else run. DeepSmooth is not built here.",
            ),
            figure=panels(f"Power, n = {self._seconds:g} s of each method", partial(_draw, found)),
        )

    def _measure(self, stage: Stage, name: str, meter: Meter) -> dict[str, Consumption]:
        clip = stage.clip(name, stage.frames)
        stage.tell(f"measuring the idle machine for {self._seconds:g} s")
        found = {IDLE: _idle(meter, self._seconds)}
        for method in WORKING:
            stage.tell(f"{name}, {method} for {self._seconds:g} s")
            corrector = create_corrector(METHODS[method], clip.intrinsics)
            found[method] = _working(meter, corrector, clip, self._seconds)
        return found


def _idle(meter: Meter, seconds: float) -> Consumption:
    start_j, start_s = meter.energy_j(), time.perf_counter()
    time.sleep(seconds)
    return Consumption(frames=0, time_s=time.perf_counter() - start_s, energy_j=meter.energy_j() - start_j)


def _working(meter: Meter, corrector: DepthCorrector, clip: FrameLoop, seconds: float) -> Consumption:
    """After a warm-up, as many frames as it can within the time."""
    frames = clip.play(2**31)
    for frame, _ in zip(frames, range(WARM_UP_FRAMES), strict=False):
        corrector.process(frame)
    start_j, start_s = meter.energy_j(), time.perf_counter()
    done, time_s = 0, 0.0
    while time_s < seconds:
        corrector.process(next(frames))
        done += 1
        time_s = time.perf_counter() - start_s
    energy_j = meter.energy_j() - start_j
    close = getattr(corrector, "close", None)
    if close is not None:
        close()
    return Consumption(frames=done, time_s=time_s, energy_j=energy_j)


def _columns() -> tuple[Column, ...]:
    return (
        Column(name="sequence"),
        Column(name="method"),
        Column(name="power", unit="W"),
        Column(name="above idle", unit="W"),
        Column(name="energy per frame", unit="J", places=4),
        Column(name="n frames", places=0),
        Column(name="time", unit="s", places=1),
    )


def _unmeasured(why: str) -> Result:
    """A result that says so, and holds no number."""
    rows = [("-", method, *(NOT_MEASURED,) * 3, 0, 0.0) for method in (IDLE, *WORKING)]

    def say(axes: "Axes") -> None:
        axes.text(0.5, 0.5, NOT_MEASURED, ha="center", va="center", fontsize=16, transform=axes.transAxes)
        labelled(axes, why[:80], "method", "power [W]")

    return Result(
        tables=(Table.of("Power: not measured", _columns(), rows),),
        claims=(Claim(paper=CLAIM, found=NOT_MEASURED, holds=None),),
        notes=(f"Power was not measured: {why}.", f"To measure it: {REMEDY}."),
        figure=panels("Power: not measured, n = 0", say),
    )


def _claim(name: str, found: Mapping[str, Consumption]) -> Claim:
    less = 100 * (1 - found["VD"].power_w / found["GS"].power_w)
    return Claim(paper=CLAIM, found=f"{name}: VD takes {less:.1f} % less power than GS", holds=less > 0)


def _draw(found: Mapping[str, Mapping[str, Consumption]], axes: "Axes") -> None:
    width = 0.8 / len(found)
    for k, (name, of_one) in enumerate(found.items()):
        axes.bar([place + k * width for place in range(len(of_one))], [one.power_w for one in of_one.values()], width,
                 label=name)  # fmt: skip
    axes.set_xticks(range(1 + len(WORKING)), (IDLE, *WORKING))
    labelled(axes, "mean while working without a pause", "method", "power [W]")
    axes.legend(fontsize=7)
