"""RQ4: registration against dense optical flow, in quality and in time."""

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

from voxdepth.baselines.optical_flow import Dis, Farneback, HornSchunck
from voxdepth.paper.registration import RegistrationConfig

from .drawing import MARKERS, labelled, panels
from .moving import ByFlow, ByRegistration, Mover, Unmoved
from .paper import FLOW_S
from .result import Claim, Column, Result, Table
from .stage import Scope, Stage
from .trial import Tally, try_pair, warm_up

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DISTANCES = (1, 3, 10, 25)
"""Frames between the reference and the later frame."""
STARTS = 4
"""References in a sequence, evenly spread."""
REGISTRATION, HORN_SCHUNCK, NONE = "registration", "Horn-Schunck", "unmoved"
BUDGET_MS = 50.0
"""The paper's limit for a frame: 20 frames per second."""

Tallies = Mapping[int, Mapping[str, Tally]]
"""By distance and mover."""


class OpticalFlow:
    """A perfect template, which is the true depth of a frame, is moved to later frames in every way."""

    name = "rq4"
    question = "Does optical flow move a template better than registration, and what does it cost (RQ4)?"
    scope = Scope(sequences=("sim-LN", "sim-MB", "sim-PLF"), frames=30, width_px=640, least_frames=2)

    def run(self, stage: Stage) -> Result:
        """See `Experiment`."""
        measured = {name: _measure(stage, name) for name in stage.sequences}
        columns = (
            Column(name="sequence"),
            Column(name="distance", unit="frames", places=0),
            Column(name="method"),
            Column(name="gray PSNR", unit="dB"),
            Column(name="depth MAE", unit="m", places=3),
            Column(name="depth median error", unit="m", places=3),
            Column(name="failed", unit="%", places=0),
            Column(name="p50", unit="ms"),
            Column(name="p95", unit="ms"),
            Column(name="n pairs", places=0),
            Column(name="n pixels", places=0),
        )
        rows = [
            (name, distance, method, tally.gray.psnr_db, tally.depth.mae_m, tally.depth.median_abs_m,
             tally.failed_percent, tally.spread.p50_ms, tally.spread.p95_ms, tally.pairs, tally.gray.pixels)
            for name, tallies in measured.items()
            for distance, by_method in tallies.items()
            for method, tally in by_method.items()
        ]  # fmt: skip
        return Result(
            tables=(Table.of("A perfect template moved to later frames", columns, rows),),
            claims=(_of_time(measured), _of_quality(measured)),
            notes=(
                "The template is the true depth of the reference, so that only the motion is judged: against the true "
                "depth of the later frame within 20 m, and against its gray image, on the pixels that all methods "
                "reach. Neither way changes depth itself as the camera comes nearer.",
                "Where registration fails it moves nothing, which is judged, too. Times are of finding the motion and "
                "moving one depth image, on one thread; the features of the template are found once, before.",
                f"On a Jetson Nano the paper measured {FLOW_S['Horn-Schunck']} s for Horn-Schunck and {FLOW_S['RAFT']} "
                "s for RAFT, which is a network and not built here.",
            ),
            figure=panels(
                "RQ4: a perfect template moved to later frames",
                *(partial(_draw_depth, tallies, name) for name, tallies in measured.items()),
                partial(_draw_times, measured),
            ),
        )


def starts(frames: int, distance: int, most: int) -> list[int]:
    """First frames of pairs that far apart, evenly spread over a sequence, at most so many."""
    last = frames - 1 - distance
    n = min(most, last + 1)
    return sorted({round(k * last / max(1, n - 1)) for k in range(n)})


def _measure(stage: Stage, name: str) -> Tallies:
    recording = stage.recording(name)
    shape = recording.intrinsics.shape
    movers: dict[str, Mover] = {
        NONE: Unmoved(),
        REGISTRATION: ByRegistration(RegistrationConfig(), shape),
        "DIS flow": ByFlow(Dis()),
        "Farneback": ByFlow(Farneback()),
        HORN_SCHUNCK: ByFlow(HornSchunck()),
    }
    warm_up(movers, recording[0], recording[1])
    tallies: dict[int, dict[str, Tally]] = {}
    for distance in (distance for distance in DISTANCES if distance < stage.frames):
        tallies[distance] = {method: Tally() for method in movers}
        for start in starts(stage.frames, distance, STARTS):
            stage.tell(f"{name}, frame {start} to frame {start + distance}")
            reference = recording[start]
            for mover in movers.values():
                mover.keep(reference.gray_left)
            try_pair(movers, reference, recording[start + distance], tallies[distance])
    return tallies


def _of_time(measured: Mapping[str, Tallies]) -> Claim:
    medians = {
        name: {method: tally.spread.p50_ms for method, tally in next(iter(tallies.values())).items() if method != NONE}
        for name, tallies in measured.items()
    }
    told = "; ".join(
        f"{name} " + ", ".join(f"{method} {ms:.1f} ms" for method, ms in of_one.items())
        for name, of_one in medians.items()
    )
    flows_ms = [ms for of_one in medians.values() for method, ms in of_one.items() if method != REGISTRATION]
    return Claim(
        paper="optical flow takes far longer than the 50 ms of a frame: Horn-Schunck 2.45 s, RAFT 15.5 s",
        found=f"{told} (median); {sum(ms > BUDGET_MS for ms in flows_ms)} of {len(flows_ms)} flows take over 50 ms",
        holds=all(ms > BUDGET_MS for ms in flows_ms),
    )


def _of_quality(measured: Mapping[str, Tallies]) -> Claim:
    better, places = 0, 0
    for tallies in measured.values():
        for of_one in tallies.values():
            errors_m = {method: tally.depth.mae_m for method, tally in of_one.items()}
            registered_m, flown_m = errors_m[REGISTRATION], errors_m["DIS flow"]
            if registered_m is not None and flown_m is not None:
                places += 1
                better += flown_m < registered_m
    return Claim(
        paper="flow predicts the movement of objects at a pixel level, more amenable to motion than registration",
        found=f"DIS flow leaves the smaller mean error of depth in {better} of {places} sequences and distances",
        holds=better > places / 2 if places else None,
    )


def _draw_depth(tallies: Tallies, name: str, axes: "Axes") -> None:
    for k, method in enumerate(next(iter(tallies.values()))):
        values = [of_one[method].depth.mae_m for of_one in tallies.values()]
        known = [float("nan") if value is None else value for value in values]
        axes.plot(list(tallies), known, marker=MARKERS[k], ms=4, label=method)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xticks(list(tallies), [str(distance) for distance in tallies])
    pairs = max(of_one[NONE].pairs for of_one in tallies.values())
    labelled(axes, f"{name}, surfaces within 20 m, n = {pairs} pairs a point", "distance [frames]", "depth MAE [m]")
    axes.legend(fontsize=7)


def _draw_times(measured: Mapping[str, Tallies], axes: "Axes") -> None:
    first = next(iter(measured.values()))
    methods = [method for method in next(iter(first.values())) if method != NONE]
    width = 0.8 / len(measured)
    for line, (name, tallies) in enumerate(measured.items()):
        times_ms = [next(iter(tallies.values()))[method].spread.p50_ms for method in methods]
        axes.bar([place + line * width for place in range(len(methods))], times_ms, width, label=name)
    axes.axhline(BUDGET_MS, color="0.4", ls="--", lw=1, label="20 frames/s")
    axes.set_xticks(range(len(methods)), methods, fontsize=7)
    axes.set_yscale("log")
    labelled(axes, "median time of a frame, one thread", "method", "time [ms]")
    axes.legend(fontsize=7)
