"""State switches: how often epochs end, and how registration fades as the camera moves."""

from collections import Counter
from collections.abc import Mapping
from functools import partial
from statistics import mean
from typing import TYPE_CHECKING

from voxdepth.corrector import PaperVoxDepth
from voxdepth.paper.config import PaperConfig
from voxdepth.paper.epochs import EpochEnd

from ..evaluation.paper import SEQUENCES
from .drawing import MARKERS, labelled, panels
from .movement import STARTS, Movement, measure
from .paper import MOVEMENT, SWITCHES, SWITCHES_FRAMES
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage

if TYPE_CHECKING:
    from matplotlib.axes import Axes

NEVER = 10**6
"""Frames in an epoch that only matches end."""
REAL, SYNTHETIC = ("sim-LN", "sim-MB"), ("sim-KTC", "sim-PLF", "sim-PLW")
"""As the paper groups its datasets, which leaves KTS out."""


class Switches:
    """The corrector's epochs over a long run, and pairs of frames at growing distances."""

    name = "switches"
    question = "How often does the state switch, and how does registration fade with movement (Table switchfrequency)?"
    scope = Scope(sequences=tuple(SEQUENCES), frames=200, width_px=320, least_frames=11)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        ends = {name: _count(stage, name) for name in stage.sequences}
        movements = {name: measure(stage, name) for name in stage.sequences}
        columns = (
            Column(name="sequence"),
            Column(name="too few matches", places=0),
            Column(name="map refused", places=0),
            Column(name="switches", places=0),
            Column(name=f"switches per {SWITCHES_FRAMES} frames", places=1),
            Column(name="with epochs of at most 60 frames", places=0),
            Column(name="n frames", places=0),
            Column(name=f"paper, {SWITCHES_FRAMES} frames", places=0),
        )
        rows = [
            (name, by_rule[EpochEnd.FEW_MATCHES], by_rule[EpochEnd.DEGENERATE], by_rule.total(), _rate(stage, by_rule),
             limited.total(), stage.frames, SWITCHES.get(SEQUENCES.get(name, "")))
            for name, (by_rule, limited) in ends.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of("Ends of epochs", columns, rows), _movements(movements)),
            claims=(_of_switches(stage, ends), _of_movement(movements)),
            notes=(
                _of_length(stage.frames),
                "An epoch ends when fewer than 5 matches are good, which is the paper's rule, or when the map that "
                "they give is impossible; our default also ends it after 60 frames, which a column of its own counts.",
                "Flow is the mean length of DIS optical flow, the paper's way to tell movement; true movement is by "
                "poses and depth, of points that stay in the image. Both in pixels of the images used here. "
                "Registration PSNR: the gray image moved by the map against the later one, peak 255, where it "
                "reaches; nothing is moved where registration fails.",
            ),
            figure=panels(
                f"State switches, n = {stage.frames} frames of each sequence",
                partial(_draw_switches, stage, ends),
                partial(_draw_movement, movements),
            ),
        )


Ends = Mapping[str, tuple[Counter[EpochEnd], Counter[EpochEnd]]]
"""Why epochs ended, by sequence: by the rules about matches alone, and with the limit to their length."""


def _count(stage: Stage, name: str) -> tuple[Counter[EpochEnd], Counter[EpochEnd]]:
    intrinsics = stage.recording(name).intrinsics
    by_rule = PaperVoxDepth(intrinsics, PaperConfig(max_epoch_frames=NEVER))
    limited = PaperVoxDepth(intrinsics, PaperConfig())
    ends: tuple[Counter[EpochEnd], Counter[EpochEnd]] = (Counter(), Counter())
    for frame in stage.frames_of(name):
        for corrector, counter in zip((by_rule, limited), ends, strict=True):
            end = corrector.align(frame).diagnostics.epoch_end
            if end is not None:
                counter[end] += 1
    by_rule.close()
    limited.close()
    return ends


def _movements(movements: Mapping[str, Mapping[int, Movement]]) -> Table:
    columns = (
        Column(name="sequence"),
        Column(name="distance", unit="frames", places=0),
        Column(name="flow", unit="px"),
        Column(name="true movement", unit="px"),
        Column(name="registration PSNR", unit="dB"),
        Column(name="failed", unit="%", places=0),
        Column(name="n pairs", places=0),
        Column(name="flow, paper", unit="px"),
        Column(name="registration PSNR, paper", unit="dB"),
    )
    rows = [
        (name, distance, mean(movement.flow_px), mean(movement.true_px) if movement.true_px else None,
         movement.gray.psnr_db,
         100 * movement.failures / len(movement.flow_px), len(movement.flow_px),
         *MOVEMENT.get(distance, (None, None)))
        for name, of_one in movements.items()
        for distance, movement in of_one.items()
    ]  # fmt: skip
    return Table.of("Pixel movement and quality of registration", columns, rows, "movement")


def _rate(stage: Stage, ends: Counter[EpochEnd]) -> float:
    """Switches per 500 frames."""
    return ends.total() * SWITCHES_FRAMES / stage.frames


def _of_length(frames: int) -> str:
    if frames == SWITCHES_FRAMES:
        return f"All {SWITCHES_FRAMES} frames of the paper's table."
    return (
        f"{frames} frames, not the paper's {SWITCHES_FRAMES}: the rates are scaled. `--frames {SWITCHES_FRAMES}` "
        "repeats the table in full."
    )


def _of_switches(stage: Stage, ends: Ends) -> Claim:
    rates = {name: _rate(stage, by_rule) for name, (by_rule, _) in ends.items()}
    groups = [[rates[name] for name in names if name in rates] for names in (REAL, SYNTHETIC)]
    claim = "40.33 % fewer switches in synthetic datasets, without KTS, than in those of a RealSense"
    if not all(groups) or mean(groups[0]) == 0:
        return Claim(paper=claim, found="no switch in sim-LN and sim-MB, or not both kinds of sequences", holds=None)
    real, synthetic = (mean(group) for group in groups)
    fewer = 100 * (1 - synthetic / real)
    return Claim(
        paper=claim,
        found=f"{abs(fewer):.1f} % {'fewer' if fewer > 0 else 'more'}: {synthetic:.1f} and {real:.1f} per "
        f"{SWITCHES_FRAMES} frames; all of ours are rendered",
        holds=fewer > 0,
    )


def _of_movement(movements: Mapping[str, Mapping[int, Movement]]) -> Claim:
    told, holds = [], []
    for name, of_one in movements.items():
        near, far = of_one.get(50), of_one.get(150)
        if near and far and near.gray.psnr_db is not None and far.gray.psnr_db is not None:
            moved = mean(near.flow_px), mean(far.flow_px)
            told.append(
                f"{name} {moved[0]:.1f} to {moved[1]:.1f} px and {near.gray.psnr_db:.2f} to {far.gray.psnr_db:.2f} dB"
            )
            holds.append(moved[1] > moved[0] and far.gray.psnr_db < near.gray.psnr_db)
    return Claim(
        paper="from 50 to 150 frames apart, flow grows from 6.75 to 10.08 px and registration falls from 16.06 to "
        "12.61 dB",
        found="; ".join(told) or "fewer than 151 frames",
        holds=sum(holds) > len(holds) / 2 if holds else None,
    )


def _draw_switches(stage: Stage, ends: Ends, axes: "Axes") -> None:
    rates = [_rate(stage, by_rule) for by_rule, _ in ends.values()]
    printed = [float(SWITCHES.get(SEQUENCES.get(name, ""), 0)) for name in ends]
    axes.bar([place - 0.2 for place in range(len(ends))], rates, 0.4, label="here, by matches alone")
    axes.bar([place + 0.2 for place in range(len(ends))], printed, 0.4, color="0.7", label="paper, other data")
    axes.set_xticks(range(len(ends)), list(ends), fontsize=7)
    labelled(axes, "epochs that ended", "sequence", f"switches per {SWITCHES_FRAMES} frames")
    axes.legend(fontsize=7)


def _draw_movement(movements: Mapping[str, Mapping[int, Movement]], axes: "Axes") -> None:
    for k, (name, of_one) in enumerate(movements.items()):
        values = [movement.gray.psnr_db for movement in of_one.values()]
        axes.plot([mean(movement.flow_px) for movement in of_one.values()],
                  [float("nan") if value is None else value for value in values], marker=MARKERS[k], ms=4,
                  label=name)  # fmt: skip
        for distance, movement in of_one.items():
            axes.annotate(str(distance), (mean(movement.flow_px), movement.gray.psnr_db or 0), fontsize=6)
    x, y = zip(*MOVEMENT.values(), strict=True)
    axes.plot(x, y, color="0.6", marker="*", label="paper, other data")
    labelled(
        axes, f"numbers: frames apart; n = up to {STARTS} pairs", "mean length of DIS flow [px]", "PSNR, peak 255 [dB]"
    )
    axes.legend(fontsize=6)
