"""Figures that a user would call better or worse, each with its unit, its direction and its tolerance.

    python -m tests.gate [--update [--because REASON]]

compares the present figures with those of `gate.toml`, and exits with 1 if one is worse by more than its tolerance.
`--update` makes the present ones the figures of the file; if one is worse, it asks for the reason, which stands in the
file. `test_gate.py` does the same in the tests. The limits of `voxdepth regress` are gates, too.
"""

import argparse
import sys
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tomli_w

from scenarios.config import load_run
from scenarios.flight import fly
from scenarios.runner import fly_and_write
from swarm.perception import frame_of
from tests.workloads import FLOWN, RECORDED, captures
from voxdepth.errors import ConfigError, VoxDepthError
from voxdepth.metrics import BELIEVED, DepthErrors, Flicker, depth_errors
from voxdepth.temporal.method import TemporalCorrector
from voxdepth.tools.viewer import RECORDING

GATE = Path(__file__).with_suffix(".toml")
SEQUENCES = ("sim-cross", "sim-drive", "sim-slats", "sim-specks")
"""One with a moving thing, and three with the errors of real depth cameras."""
FRAMES = 30
MAX_RANGE_M = 20.0
IMAGES = {"rig.width_px": 424, "rig.height_px": 240, "renderer": "raster"}
RIGHT = 0.05
"""Largest error of a right pixel, as a share of the true depth."""
SCENARIOS = ("city", "crossing", "forest", "gap", "moving", "paper")
RECORDED_SCENARIOS = ("moving", "paper")


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure of the gate."""

    name: str
    value: float
    unit: str
    better: str
    """`larger` or `smaller`."""
    tolerance: float
    """Largest difference that is neither better nor worse, in the unit."""
    because: str = ""
    """Why it is worse than it was, where it became so."""

    def change(self, before: "Figure") -> str:
        """`better`, `worse` or `same`, compared with an earlier value."""
        gain = (self.value - before.value) * (1 if self.better == "larger" else -1)
        return "same" if abs(gain) <= self.tolerance else "better" if gain > 0 else "worse"


def figures() -> Iterator[Figure]:
    """Measure all figures."""
    for sequence in SEQUENCES:
        yield from depth_figures(sequence)
    for scenario in SCENARIOS:
        yield from flight_figures(scenario)
    for scenario in RECORDED_SCENARIOS:
        yield recording_figure(scenario)


def depth_figures(sequence: str) -> Iterator[Figure]:
    """How right the default corrector is in a sequence of captures, and how right where it is sure."""
    seen = list(captures(sequence, FRAMES, **IMAGES))
    corrector = TemporalCorrector(seen[0].intrinsics)
    pairs = [(capture, corrector.process(frame_of(capture))) for capture in seen]
    errors, flicker = DepthErrors(), Flicker()
    for capture, result in pairs:
        errors += depth_errors(result.depth_m, capture.depth_true_m, max_range_m=MAX_RANGE_M)
        in_range = capture.depth_true_m <= MAX_RANGE_M
        flicker.add(result.depth_m, np.where(in_range, capture.depth_true_m, np.float32(0)), in_range)
    of_sequence = errors.mae_m, errors.too_far_share, errors.hole_share, flicker.mean_change_m
    mae_m, too_far, holes, flicker_m = (value or 0.0 for value in of_sequence)
    error = [np.abs(result.depth_m / capture.depth_true_m - 1) for capture, result in pairs]
    believed = [(result.depth_m > 0) & (result.confidence >= BELIEVED) for _, result in pairs]
    right = np.mean(np.concatenate([each[sure] for each, sure in zip(error, believed, strict=True)]) <= RIGHT)
    of = f"depth in {sequence}"
    yield Figure(name=f"{of}: mean error", value=mae_m, unit="m", better="smaller", tolerance=0.02 + 0.02 * mae_m)
    yield Figure(name=f"{of}: too far", value=100 * too_far, unit="%", better="smaller", tolerance=0.5)
    yield Figure(name=f"{of}: holes", value=100 * holes, unit="%", better="smaller", tolerance=1.0)
    yield Figure(name=f"{of}: flicker", value=1000 * flicker_m, unit="mm", better="smaller", tolerance=5.0)
    yield Figure(name=f"{of}: believed", value=100 * np.mean(believed), unit="%", better="larger", tolerance=1.0)
    yield Figure(name=f"{of}: right of believed", value=100 * right, unit="%", better="larger", tolerance=0.5)


def flight_figures(scenario: str) -> Iterator[Figure]:
    """How far a swarm comes in a flight, what it hits, and how near it comes to surfaces."""
    metrics = fly(load_run(scenario, 1, FLOWN), threads=1).result.metrics
    hits = sum(float(value or 0) for name, value in metrics.items() if name.startswith("collisions_"))
    progress_m, clearance_m = (float(metrics[name] or 0) for name in ("leader_progress_m", "min_clearance_m"))
    of = f"flight in {scenario}"
    yield Figure(name=f"{of}: progress of the leader", value=progress_m, unit="m", better="larger", tolerance=2.0)
    yield Figure(name=f"{of}: collisions", value=hits, unit="1", better="smaller", tolerance=0.0)
    yield Figure(name=f"{of}: smallest clearance", value=clearance_m, unit="m", better="larger", tolerance=0.25)


def recording_figure(scenario: str) -> Figure:
    """The size of the recording of a flight."""
    with TemporaryDirectory() as folder:
        written = fly_and_write(load_run(scenario, 1, FLOWN | RECORDED), Path(folder), record=True).folder
        assert written is not None
        size_kb = (written / RECORDING).stat().st_size / 1000
    name = f"recording of {scenario}: size"
    return Figure(name=name, value=size_kb, unit="kB", better="smaller", tolerance=0.1 * size_kb)


def read(path: Path | None = None) -> dict[str, Figure]:
    """The figures of a file, by name."""
    return {one["name"]: Figure(**one) for one in tomllib.loads((path or GATE).read_text())["figure"]}


def write(measured: Sequence[Figure]) -> None:
    """Write figures with six digits, without reasons that are empty."""
    kept = [replace(one, value=float(f"{one.value:.6g}"), tolerance=float(f"{one.tolerance:.3g}")) for one in measured]
    tables = [{key: value for key, value in asdict(one).items() if value != ""} for one in kept]
    GATE.write_text(tomli_w.dumps({"figure": tables}))


def judge(measured: Sequence[Figure], before: dict[str, Figure]) -> dict[str, list[Figure]]:
    """The figures by their change; one of the file that is not measured is a `ConfigError`."""
    if gone := sorted(set(before) - {one.name for one in measured}):
        raise ConfigError(f"{GATE.name} has figures that are not measured: {', '.join(gone)}; write it with --update")
    found: dict[str, list[Figure]] = {"better": [], "worse": [], "new": [], "same": []}
    for one in measured:
        found[one.change(before[one.name]) if one.name in before else "new"].append(one)
    return found


def lines(found: dict[str, list[Figure]], before: dict[str, Figure]) -> Iterator[str]:
    """What changed, a line for each figure, the worse ones first."""
    for change in ("worse", "better"):
        for one in found[change]:
            was = before[one.name].value
            yield f"{change}: {one.name}: {was:.4g} became {one.value:.4g} {one.unit} (tolerance {one.tolerance:.2g})"
    yield from (f"new: {one.name}: {one.value:.4g} {one.unit}" for one in found["new"])


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare or update the figures; return 1 if one is worse without a reason."""
    parser = argparse.ArgumentParser(prog="python -m tests.gate", description=__doc__.splitlines()[0])
    parser.add_argument("--update", action="store_true", help="make the present figures those of the file")
    parser.add_argument("--because", default="", help="with --update: why figures are worse")
    given = parser.parse_args(arguments)
    before, measured = read() if GATE.exists() else {}, list(figures())
    try:
        known = {name: one for name, one in before.items() if not given.update or name in {m.name for m in measured}}
        found = judge(measured, known)
    except VoxDepthError as error:
        print(f"gate: {error}", file=sys.stderr)
        return 2
    for line in lines(found, before):
        print(line)
    print(", ".join(f"{len(those)} {change}" for change, those in found.items()))
    if not given.update:
        return 1 if found["worse"] else 0
    if found["worse"] and not given.because:
        print("gate: figures are worse: say why with --because, or mend it", file=sys.stderr)
        return 1
    now = {one.name: one for one in measured}
    # What is the same keeps its value, so that many small changes add up, and its reason.
    now |= {one.name: before[one.name] for one in found["same"]}
    now |= {one.name: replace(one, because=given.because) for one in found["worse"]}
    write(list(now.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
