"""RQ2: the size that frames are reduced to for registration, against its time and its quality."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from voxdepth.paper.config import PaperConfig
from voxdepth.paper.registration import RegistrationConfig

from ..evaluation.groups import ALL
from ..evaluation.measurements import COMPLETED, Selector
from .drawing import MARKERS, labelled, panels
from .moving import ByRegistration, Mover, Unmoved
from .optical_flow import starts
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage
from .trial import Tally, try_pair, warm_up
from .variants import variant

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZES_PX = (100, 150, 200, 300, 400, 600)
"""Width and height that gray images are reduced to."""
CHOSEN_PX = 200
"""The paper's."""
DISTANCE = 10
"""Frames between the two images of a pair."""
STARTS = 10
"""Pairs in a sequence."""
UNMOVED = 0
"""Stands for no registration at all."""

Tallies = Mapping[int, Tally]
"""By size."""


class FrameSize:
    """Registration at each size: of pairs of frames, and within the corrector."""

    name = "rq2"
    question = "Which frame size gives good registration in little time (RQ2)?"
    scope = Scope(sequences=("sim-LN", "sim-MB", "sim-KTC", "sim-PLF"), frames=30, width_px=640, least_frames=16)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        measured = {name: _measure(stage, name) for name in stage.sequences}
        methods = [variant(f"size-{size_px}", _config(size_px)) for size_px in SIZES_PX]
        done = stage.judged(methods)
        psnrs_db: dict[tuple[str, int], float | None] = {}
        for name in stage.sequences:
            for size_px, method in zip(SIZES_PX, methods, strict=True):
                selector = Selector("psnr16_mm", "all", ALL, COMPLETED)
                psnrs_db[name, size_px] = done.measurements.value(name, method.name, selector)
        columns = (
            Column(name="sequence"),
            Column(name="size", unit="px", places=0),
            Column(name="registration PSNR", unit="dB"),
            Column(name="failed", unit="%", places=0),
            Column(name="p50", unit="ms"),
            Column(name="p95", unit="ms"),
            Column(name="n pairs", places=0),
            Column(name="corrected PSNR", unit="dB"),
            Column(name="n frames", places=0),
        )
        rows = [
            (name, size_px, tally.gray.psnr_db, tally.failed_percent, tally.spread.p50_ms, tally.spread.p95_ms,
             tally.pairs, psnrs_db.get((name, size_px)), stage.frames)
            for name, tallies in measured.items()
            for size_px, tally in tallies.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of(f"Registration of frames {DISTANCE} apart, and depth corrected with it", columns, rows),),
            claims=(_of_quality(measured), _of_time(measured)),
            notes=(
                "Registration PSNR: the earlier gray image moved by the map against the later one, peak 255, on the "
                "pixels that all sizes reach; size 0 moves nothing, as does a registration that fails.",
                "Corrected PSNR: depth after completion, peak 65535 mm, all frames, those before the first template, "
                "too.",
                "Times are of describing the later frame, matching, and moving one depth image, on one thread. At "
                "most 200 features are kept at every size.",
            ),
            figure=panels(
                f"RQ2: size of frames, n = up to {STARTS} pairs, {stage.frames} frames",
                partial(_draw_registration, measured),
                partial(_draw_depth, measured, psnrs_db),
            ),
        )


def _config(size_px: int) -> PaperConfig:
    return PaperConfig(registration=RegistrationConfig(size_px=size_px))


def _measure(stage: Stage, name: str) -> Tallies:
    recording = stage.recording(name)
    movers: dict[str, Mover] = {str(UNMOVED): Unmoved()}
    for size_px in SIZES_PX:
        movers[str(size_px)] = ByRegistration(RegistrationConfig(size_px=size_px), recording.intrinsics.shape)
    tallies = {size: Tally() for size in movers}
    warm_up(movers, recording[0], recording[1])
    for start in starts(stage.frames, DISTANCE, STARTS):
        stage.tell(f"{name}, frame {start} to frame {start + DISTANCE}")
        reference = recording[start]
        for mover in movers.values():
            mover.keep(reference.gray_left)
        try_pair(movers, reference, recording[start + DISTANCE], tallies)
    return {int(size): tally for size, tally in tallies.items()}


def _of_quality(measured: Mapping[str, Tallies]) -> Claim:
    """Whether the chosen size registers better than every larger one."""
    told, holds = [], []
    for name, tallies in measured.items():
        psnrs_db = {size_px: tallies[size_px].gray.psnr_db for size_px in SIZES_PX}
        chosen_db = psnrs_db[CHOSEN_PX]
        larger = [psnr_db for size_px, psnr_db in psnrs_db.items() if size_px > CHOSEN_PX and psnr_db is not None]
        if chosen_db is not None and larger:
            told.append(f"{name} {100 * (chosen_db / max(larger) - 1):+.1f} %")
            holds.append(chosen_db > max(larger))
    return Claim(
        paper="200 x 200 has 73 % better registration quality than higher resolutions",
        found=f"PSNR of 200 x 200 over that of the best larger size: {', '.join(told)}",
        holds=all(holds) if holds else None,
    )


def _of_time(measured: Mapping[str, Tallies]) -> Claim:
    ratios = {
        name: tallies[SIZES_PX[-1]].spread.p50_ms / tallies[CHOSEN_PX].spread.p50_ms
        for name, tallies in measured.items()
    }
    told = ", ".join(f"{name} {ratio:.1f}" for name, ratio in ratios.items())
    return Claim(
        paper="200 x 200 is three times as fast as higher resolutions",
        found=f"times as fast as {SIZES_PX[-1]} x {SIZES_PX[-1]}: {told}",
        holds=all(round(ratio) >= 3 for ratio in ratios.values()),
    )


def _draw_registration(measured: Mapping[str, Tallies], axes: "Axes") -> None:
    for k, (name, tallies) in enumerate(measured.items()):
        points = [
            (tallies[size_px].spread.p50_ms, psnr_db, size_px)
            for size_px in SIZES_PX
            if (psnr_db := tallies[size_px].gray.psnr_db) is not None
        ]
        _line(axes, name, points, k)
    labelled(axes, "registration, numbers are sizes [px]", "median time [ms]", "PSNR of gray, peak 255 [dB]")
    axes.legend(fontsize=7)


def _draw_depth(
    measured: Mapping[str, Tallies], psnrs_db: Mapping[tuple[str, int], float | None], axes: "Axes"
) -> None:
    for k, (name, tallies) in enumerate(measured.items()):
        points = [
            (tallies[size_px].spread.p50_ms, psnr_db, size_px)
            for size_px in SIZES_PX
            if (psnr_db := psnrs_db[name, size_px]) is not None
        ]
        _line(axes, name, points, k)
    labelled(axes, "corrected depth", "median time of registration [ms]", "PSNR, peak 65535 mm [dB]")


def _line(axes: "Axes", name: str, points: list[tuple[float, float, int]], k: int) -> None:
    x, y, sizes = zip(*points, strict=True) if points else ((), (), ())
    axes.plot(x, y, marker=MARKERS[k], ms=4, label=name)
    for at_ms, psnr_db, size_px in zip(x, y, sizes, strict=True):
        axes.annotate(str(size_px), (at_ms, psnr_db), fontsize=6, xytext=(2, 3), textcoords="offset points")
