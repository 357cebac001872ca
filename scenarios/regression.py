"""Regression of a depth corrector on synthetic noise: each term alone at three levels, against golden figures."""

import importlib
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sim.testing import FRAMES, LEVELS, TERMS, Level, Term, noisy_sequence
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.metrics import DepthErrors, Flicker, depth_errors
from voxdepth.model import Model
from voxdepth.registry import corrector_names, create_corrector
from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics

from .errors import ScenarioError

MAX_RANGE_M = 20.0
SEED = 0
TOLERANCES = {
    "mae_m": (0.002, 0.02),
    "too_far_share": (0.002, 0.02),
    "hole_share": (0.002, 0.02),
    "flicker_m": (0.002, 0.02),
}
"""By metric, how far a figure may be from the golden one: an absolute part and a part of the golden figure."""

Table = dict[str, dict[str, float | None]]
"""Figures by metric, by case, as in `scale/low`."""
CorrectorFactory = Callable[[Intrinsics], DepthCorrector]


class Figures(Model):
    """What is measured of one case; smaller is better. None when no pixel had a depth."""

    mae_m: float | None
    """Mean absolute error."""
    too_far_share: float | None
    """Share of pixels more than 10 % too far."""
    hole_share: float | None
    flicker_m: float | None
    """Mean absolute change of the error from frame to frame."""


class Golden(Model):
    """A file of golden figures."""

    seed: int
    frames: int
    cases: dict[str, Figures]


@dataclass(frozen=True, kw_only=True)
class Difference:
    """A figure that is not what it was."""

    case: str
    metric: str
    golden: float | None
    measured: float | None

    @property
    def excess(self) -> float:
        """Difference over tolerance: above 1 by definition, infinite where one of the figures is missing."""
        return _excess(self.metric, self.golden, self.measured)

    @property
    def worse(self) -> bool:
        """Whether it went the wrong way; all metrics are better when smaller."""
        if self.measured is None or self.golden is None:
            return self.measured is None
        return self.measured > self.golden


def find_corrector(name: str) -> CorrectorFactory:
    """A corrector by its registered name, or your own as `package.module:factory`.

    Raises:
        ScenarioError: The module or the factory is not there.
    """
    if ":" not in name:
        if name not in corrector_names():
            raise ScenarioError(
                f"there is no corrector {name!r}; choose one of {', '.join(corrector_names())}, or give your own as "
                "package.module:factory"
            )
        return lambda intrinsics: create_corrector(name, intrinsics)
    module_name, _, attribute = name.partition(":")
    sys.path.insert(0, str(Path.cwd()))  # as `python -m` does; an installed command has its own folder there
    try:
        factory: CorrectorFactory = getattr(importlib.import_module(module_name), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ScenarioError(
            f"cannot find the corrector {name!r}: {error}; expected package.module:factory, where factory(intrinsics) "
            "returns a DepthCorrector"
        ) from error
    return factory


def measure(make: CorrectorFactory, progress: Callable[[str], None], *, frames: int = FRAMES) -> Table:
    """The figures of all cases; `progress` is told of each case before it runs."""
    table: Table = {}
    for term in TERMS:
        for level in LEVELS:
            progress(f"{term}/{level}")
            table[f"{term}/{level}"] = _measure_case(make, term, level, frames)
    return table


def corrected(
    make: CorrectorFactory, term: Term, level: Level, frames: int = FRAMES
) -> Iterator[tuple[Capture, CorrectedDepth]]:
    """The captures of a case with what a new corrector makes of them."""
    corrector: DepthCorrector | None = None
    for k, capture in enumerate(noisy_sequence(term, level, SEED, frames=frames)):
        frame = frame_of(capture)
        for given in (frame.gray, frame.depth_m):
            given.setflags(write=False)
        try:
            corrector = corrector or make(capture.intrinsics)
            result = corrector.process(frame)
            _require_depth(result, frame)
        except Exception as error:  # whatever a corrector of yours does, say where it did it
            raise ScenarioError(f"the corrector failed on {term}/{level}, frame {k}: {_named(error)}") from error
        yield capture, result


def _require_depth(result: CorrectedDepth, frame: Frame) -> None:
    depth_m = getattr(result, "depth_m", None)
    if not isinstance(depth_m, np.ndarray) or depth_m.shape != frame.depth_m.shape:
        raise ScenarioError(
            f"expected a CorrectedDepth with depth_m of shape {frame.depth_m.shape}, got {type(result).__name__} with "
            f"{getattr(depth_m, 'shape', 'none')}"
        )
    if not (np.isfinite(depth_m).all() and (depth_m >= 0).all()):
        raise ScenarioError("expected depths that are finite and not negative (0 = invalid), got others")


def _named(error: Exception) -> str:
    return str(error) if isinstance(error, ScenarioError) else f"{type(error).__name__}: {error}"


def _measure_case(make: CorrectorFactory, term: Term, level: Level, frames: int) -> dict[str, float | None]:
    errors, flicker = DepthErrors(), Flicker()
    for capture, result in corrected(make, term, level, frames):
        errors += depth_errors(result.depth_m, capture.depth_true_m, max_range_m=MAX_RANGE_M)
        in_range = capture.depth_true_m <= MAX_RANGE_M
        flicker.add(result.depth_m, np.where(in_range, capture.depth_true_m, np.float32(0)), in_range)
    return {
        "mae_m": errors.mae_m,
        "too_far_share": errors.too_far_share,
        "hole_share": errors.hole_share,
        "flicker_m": flicker.total.mean_change_m,
    }


def compare(golden: Table, measured: Table) -> list[Difference]:
    """All figures outside of their tolerances, the farthest first.

    Raises:
        ScenarioError: The golden figures are of other cases.
    """
    if golden.keys() != measured.keys():
        raise ScenarioError(
            f"the golden figures are of other cases than the measured ones ({len(golden)} and {len(measured)}): "
            "write new ones with --update"
        )
    differences = [
        Difference(case=case, metric=metric, golden=golden[case][metric], measured=value)
        for case, figures in measured.items()
        for metric, value in figures.items()
    ]
    return sorted((d for d in differences if d.excess > 1), key=lambda d: -d.excess)


def _excess(metric: str, golden: float | None, measured: float | None) -> float:
    if golden is None or measured is None:
        return 0.0 if golden is measured else float("inf")
    absolute, relative = TOLERANCES[metric]
    return abs(measured - golden) / (absolute + relative * abs(golden))


def golden_path(folder: Path, corrector: str) -> Path:
    """File of the golden figures of a corrector."""
    return folder / f"{corrector.replace(':', '-')}.json"


def read_golden(path: Path) -> Table:
    """Golden figures.

    Raises:
        ScenarioError: There are none, they are not what `write_golden` writes, or of other sequences than today's.
    """
    try:
        golden = Golden.model_validate_json(path.read_bytes(), strict=True)
    except FileNotFoundError as error:
        raise ScenarioError(f"there are no golden figures at {path}: write them with --update") from error
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:160]
        raise ScenarioError(f"cannot read the golden figures {path}: {reason}; write new ones with --update") from error
    if (golden.seed, golden.frames) != (SEED, FRAMES):
        raise ScenarioError(
            f"the golden figures {path} are of seed {golden.seed} and {golden.frames} frames, expected {SEED} and "
            f"{FRAMES}: write new ones with --update"
        )
    return {case: dict(figures) for case, figures in golden.cases.items()}


def write_golden(path: Path, table: Table) -> None:
    """Write golden figures, with what they were measured on.

    Raises:
        ScenarioError: The file cannot be written.
    """
    golden = Golden(seed=SEED, frames=FRAMES, cases={case: Figures(**figures) for case, figures in table.items()})
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(golden.model_dump_json(indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise ScenarioError(f"cannot write the golden figures {path}: {error.strerror}") from error


def split_case(case: str) -> tuple[Term, Level]:
    """Term and level of a case."""
    term, level = case.split("/")
    return next(t for t in TERMS if t == term), next(one for one in LEVELS if one == level)
