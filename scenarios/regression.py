"""Regression test of a depth corrector: errors under each noise term alone, at three levels, against golden values."""

import json
from collections.abc import Callable, Iterable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd

from sim.testing import FRAMES, LEVELS, TERMS, Level, Term, noisy_sequence
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.corrector_spec import CorrectorFactory
from voxdepth.errors import PluginError
from voxdepth.metrics import DepthErrors, Flicker, depth_errors
from voxdepth.tools.files import write
from voxdepth.tools.table import Table
from voxdepth.types import CorrectedDepth, DepthCorrector

from .errors import ScenarioError

MAX_RANGE_M = 20.0
SEED = 0
METRICS = ["mae_m", "too_far_share", "hole_share", "flicker_m"]
"""Mean absolute error, share of pixels more than 10 % too far, share of pixels without depth, and mean absolute change
of the error between two frames. All are better when smaller."""
ABSOLUTE, RELATIVE = 0.002, 0.02
"""Largest difference from the golden value: an absolute part, and a part relative to the golden value."""
OUTSIDE = "outside of the tolerance; the excess is the difference divided by the tolerance"
"""Title of a table of differences."""
CASES: dict[str, tuple[Term, Level]] = {f"{term}/{level}": (term, level) for term, level in product(TERMS, LEVELS)}
"""Noise term and level by case."""


def measure(make: CorrectorFactory, progress: Callable[[str], None]) -> pd.DataFrame:
    """Measure `METRICS` (columns) of all cases, NaN if undefined; `progress` receives each case before it runs."""
    cases = {}
    for case in CASES:
        progress(case)
        cases[case] = metrics_of(corrected(make, case))
    return pd.DataFrame.from_dict(cases, orient="index", columns=METRICS, dtype=float)


def metrics_of(results: Iterable[tuple[Capture, CorrectedDepth]]) -> tuple[float | None, ...]:
    """Return the `METRICS` of successive captures with their corrections, None where one is undefined."""
    errors, flicker = DepthErrors(), Flicker()
    for capture, result in results:
        errors += depth_errors(result.depth_m, capture.depth_true_m, max_range_m=MAX_RANGE_M)
        in_range = capture.depth_true_m <= MAX_RANGE_M
        flicker.add(result.depth_m, np.where(in_range, capture.depth_true_m, np.float32(0)), in_range)
    return errors.mae_m, errors.too_far_share, errors.hole_share, flicker.mean_change_m


def corrected(make: CorrectorFactory, case: str, frames: int = FRAMES) -> Iterator[tuple[Capture, CorrectedDepth]]:
    """Yield the captures of a case with their corrections by a new corrector; its failure is a `ScenarioError`."""
    corrector: DepthCorrector | None = None
    for k, capture in enumerate(noisy_sequence(*CASES[case], SEED, frames=frames)):
        frame = frame_of(capture)
        for given in (frame.gray, frame.depth_m):
            given.setflags(write=False)
        try:
            corrector = corrector or make(capture.intrinsics)
            result = corrector.process(frame)
        except Exception as error:  # A user's corrector may raise anything; the message says where.
            text = str(error) if isinstance(error, PluginError) else f"{type(error).__name__}: {error}"
            raise ScenarioError(f"the corrector failed on {case}, frame {k}: {text}") from error
        yield capture, result


def compare(golden: pd.DataFrame, measured: pd.DataFrame) -> pd.DataFrame:
    """Return a row for each metric outside of its tolerance, the largest excess first.

    Other cases are a `ScenarioError`. The excess is the difference in tolerances, infinite if one is missing.
    """
    if set(golden.index) != set(measured.index):
        raise ScenarioError(
            f"{len(golden)} golden cases do not match {len(measured)} measured ones: write new ones with --update"
        )
    both = pd.DataFrame({"golden": golden.stack(), "now": measured.stack()}).dropna(how="all")
    before, now = both["golden"], both["now"]
    excess = ((now - before).abs() / (ABSOLUTE + RELATIVE * before.abs())).fillna(np.inf)
    is_worse = now.isna() | (now > before)
    found = both.assign(change=np.where(is_worse, "worse", "better"), excess=excess)[excess > 1]
    return found.rename_axis(["noise", "metric"]).sort_values("excess", ascending=False, kind="stable").reset_index()


def metric_table(cases: pd.DataFrame, corrector: str) -> Table:
    """Return the metrics of all cases."""
    headings = ["MAE [m]", "more than 10 % too far [%]", "holes [%]", "flicker [m]"]
    shown = (cases * [1, 100, 100, 1]).set_axis(headings, axis=1).rename_axis("noise").reset_index()
    return Table.of_frame(f"corrector {corrector}, one noise term at a time", shown)


def golden_path(folder: Path, corrector: str) -> Path:
    """Return the path of the golden file of a corrector."""
    return folder / f"{corrector.replace(':', '-')}.json"


def read_golden(path: Path) -> pd.DataFrame:
    """Read a golden file; one that is missing, damaged or of other sequences is a `ScenarioError`."""
    try:
        golden = json.loads(path.read_bytes())
        cases = pd.DataFrame.from_dict(golden["cases"], orient="index", dtype=float)[METRICS]
        made_of = golden["seed"], golden["frames"]
    except FileNotFoundError as error:
        raise ScenarioError(f"there are no golden metrics at {path}: write them with --update") from error
    except (OSError, ValueError, TypeError, LookupError, AttributeError) as error:
        raise ScenarioError(
            f"cannot read the golden metrics {path}: expected the metrics {', '.join(METRICS)} of every case, got "
            f"{type(error).__name__}: {error}; write new ones with --update"
        ) from error
    if made_of != (SEED, FRAMES):
        found = f"{path} are of seed {made_of[0]} and {made_of[1]} frames, expected {SEED} and {FRAMES}"
        raise ScenarioError(f"the golden metrics {found}: write new ones with --update")
    return cases


def write_golden(path: Path, cases: pd.DataFrame, because: str = "") -> None:
    """Write a golden file, with null where no pixel had a depth; a failure is a `ToolError`.

    `because` says why metrics became worse, if any did.
    """
    values = cases.astype(object).where(cases.notna(), None).to_dict("index")
    golden = {"seed": SEED, "frames": FRAMES, **({"because": because} if because else {}), "cases": values}
    write(path, f"{json.dumps(golden, indent=1)}\n".encode())
