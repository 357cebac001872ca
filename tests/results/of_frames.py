"""Results about frames: how right they are corrected, and in what time."""

from collections.abc import Sequence
from statistics import median, quantiles

import numpy as np

from scenarios.evaluation import Shipped
from scenarios.regression.clips import CASES, SEEDS, Here, clips
from scenarios.regression.figures import ERROR, FIGURES, FLICKER, MEASURED, STATIC, Figure, scores
from scenarios.sequences import GROUPS, load_sequence
from sim.testing import FRAMES
from tests import calibrate, camera_errors, odometries
from voxdepth.corrector_spec import CorrectorSpec
from voxdepth.temporal.ablations import ABLATIONS
from voxdepth.tools.benchmark import FRAME, N_FRAMES, camera_of, measure
from voxdepth.tools.evaluate import requested_of
from voxdepth.tools.evaluation.methods import find_methods
from voxdepth.tools.evaluation.quantities import ERROR_IN_HOLES
from voxdepth.tools.evaluation.report import method_table
from voxdepth.tools.evaluation.shares import PixelKind
from voxdepth.tools.evaluation.suite import Evaluation, EvaluationSequence, Plan, evaluate
from voxdepth.tools.recorded import Opener, restrict_opencv
from voxdepth.tools.results.table import Column, Table, Value
from voxdepth.types import FloatArray

from .data import Data, Made, MissingDataError

SIZES = ((160, 96), (480, 270), (640, 360), (848, 480))
REAL = ("aloe", "cones", "d435-arm", "d435-hand", "kinect", "kitti", "motorcycle")
"""Recordings by the names of their folders; docs/corrector.md says what they are."""
ABLATED = ("cones", "d435-arm", "kitti")
"""Recordings by which parts are evaluated: of a pair, of a camera at stations, and of one that moves."""
REAL_FRAMES, ABLATION_FRAMES, CALIBRATION_FRAMES, RENDERED_FRAMES = 40, 12, 30, 30
UNSEEN_SEED = 2024
"""Of rendered sequences by which nothing was trained or tuned."""
BASELINES = ("raw", "realsense-left", "realsense", "ip-basic", "global-smoother", "telea", "navier-stokes")
RIGHT = f"Share of pixels within 5 % of the reference, at most {REAL_FRAMES} frames of each recording"
WHOLE = "temporal"
SMOOTHING = ("raw", "median", "realsense", "voxdepth", WHOLE)
"""Methods that change measured pixels, and raw depth."""
PARTS = (
    *(f"{WHOLE}[without={part}]" for part in ABLATIONS),
    *(f"{WHOLE}[{setting}]" for setting in ("shadow_factor=1", "smoothing_window_px=1", "decimation=1")),
)
"""The default method without one of its parts."""


def performance(_: Data) -> Made:
    """How long a frame takes."""
    methods: dict[str, list[Value]] = {}
    steps: dict[str, list[Value]] = {}
    slowest: dict[str, list[Value]] = {}
    for width_px, height_px in SIZES:
        times_s = measure(camera_of(width_px, height_px), N_FRAMES)
        medians_ms = {name: 1e3 * median(of[FRAME]) for name, of in times_s.items()}
        first_ms = next(iter(medians_ms.values()))
        for name, median_ms in medians_ms.items():
            methods.setdefault(name, []).extend([median_ms, median_ms / first_ms])
            slowest.setdefault(name, []).append(1e3 * quantiles(times_s[name][FRAME], n=100)[-1])
        for step, of_step in times_s[WHOLE].items():
            steps.setdefault(step, []).append(1e3 * median(of_step))
    sizes = [f"{width_px}x{height_px}" for width_px, height_px in SIZES]
    both = [column for size in sizes for column in (Column(size, "ms", ".1f"), Column(f"{size}, ratio"))]
    return Made(
        {
            "methods": Table.of(
                f"Median time of a frame, {N_FRAMES} frames, and its ratio to the first method",
                ["method", *both],
                [[name, *row] for name, row in methods.items()],
            ),
            "slowest": Table.of(
                f"99th percentile of the time of a frame, {N_FRAMES} frames",
                ["method", *(Column(size, "ms", ".1f") for size in sizes)],
                [[name, *row] for name, row in slowest.items()],
            ),
            "steps": Table.of(
                f"Median time of each step of {WHOLE}",
                ["step", *(Column(size, "ms") for size in sizes)],
                [[step, *row] for step, row in steps.items()],
            ),
        }
    )


def real(data: Data) -> Made:
    """How many pixels of real cameras are filled right, beside the best baseline."""
    evaluation = _evaluated(_recorded(data, REAL), [*BASELINES, WHOLE], REAL_FRAMES, data)
    rows: list[list[Value]] = []
    of_kinds: dict[str, list[PixelKind]] = {}
    for shares in evaluation.shares:
        for kind in shares.kinds.values():
            other = _best_other(kind)
            lead = _points(kind, WHOLE, other)
            rows.append([f"{shares.recording}, {kind.title}", *_two_shares(kind, other), lead])
            of_kinds.setdefault(kind.title, []).append(kind)
    summary: list[list[Value]] = []
    for title, kinds in of_kinds.items():
        means = {name: sum(kind.share(name).value for kind in kinds) / len(kinds) for name in (WHOLE, *BASELINES)}
        best = max(BASELINES, key=lambda name: means[name])
        summary.append([title, f"{100 * means[WHOLE]:.1f}", f"{100 * means[best]:.1f} `{best}`"])
    headings = ["pixels", "default [%]", "best baseline [%]"]
    return Made(
        {
            "summary": Table.of(f"{RIGHT}, mean over {len(REAL)} recordings", headings, summary),
            "leads": Table.of(RIGHT, [*headings, "lead in points, 95 % interval"], rows),
        }
    )


def ablations(data: Data) -> Made:
    """What each part of the default method is worth on real cameras."""
    evaluation = _evaluated(_recorded(data, ABLATED), [WHOLE, *PARTS], ABLATION_FRAMES, data)
    rows = [[_part(name), *(_points(shares.overall, name, WHOLE) for shares in evaluation.shares)] for name in PARTS]
    title = "Change in points of the pixels within 5 % of the reference, 95 % interval"
    columns = ["without", *(shares.recording for shares in evaluation.shares)]
    return Made({"parts": Table.of(f"{title}, at most {ABLATION_FRAMES} frames", columns, rows)})


def calibration(data: Data) -> Made:
    """Whether the confidence is the share that is right, by recordings that it was not fitted to."""
    folders = [data.of_camera(name) for name in REAL]
    fills, measured = calibrate.tables_of(folders, CALIBRATION_FRAMES)
    return Made({"fills": fills, "measured": measured})


def rendered(data: Data) -> Made:
    """How many pixels of rendered sequences in holes are right, and how large the errors of the network are."""
    tables = {}
    for word in ("reference", "artefacts"):
        requested = [Shipped(load_sequence(name, 0, {})) for name in GROUPS[word]]
        evaluation = _evaluated(requested, [*BASELINES, WHOLE], RENDERED_FRAMES, data)
        rows = [
            [shares.recording, *_two_shares(shares.overall, _best_other(shares.overall))]
            for shares in evaluation.shares
        ]
        title = f"Share of the pixels in holes within 5 % of the truth, {RENDERED_FRAMES} frames of each sequence"
        tables[word] = Table.of(title, ["sequence", "default [%]", "best baseline [%]"], rows)
    unseen = [Shipped(load_sequence(name, UNSEEN_SEED, {})) for name in GROUPS["reference"]]
    evaluation = _evaluated(unseen, [WHOLE, f"{WHOLE}[fill=all]", "learned"], RENDERED_FRAMES, data)
    return Made({**tables, "learned": method_table(evaluation, ERROR_IN_HOLES)})


def synthetic(_: Data) -> Made:
    """What correctors make of one term of synthetic noise at a time, at its highest level."""
    values: dict[str, dict[str, list[FloatArray]]] = {}
    for clip in clips([case for case in CASES if case.endswith("/high")]):
        of_term = values.setdefault(clip.case.removesuffix("/high"), {name: [] for name in SMOOTHING})
        for name, of_seeds in of_term.items():
            results = Here(CorrectorSpec.of(name).create)(clip).results
            of_seeds.append(scores(clip, results).of_clip)
    tables = {}
    shown = {
        "flicker": ("Flicker of surfaces that stay", Figure(STATIC, FLICKER)),
        "measured": ("Mean absolute error of measured pixels", Figure(MEASURED, ERROR)),
    }
    for key, (what, figure) in shown.items():
        column = FIGURES.index(figure)
        rows = [
            [term, *(float(np.mean(of_seeds, axis=0)[column]) for of_seeds in of_term.values())]
            for term, of_term in values.items()
        ]
        title = f"{what}, by term of noise, mean over {len(SEEDS)} seeds of {FRAMES} frames"
        tables[key] = Table.of(title, ["noise", *(Column(name, "m", ".3f") for name in SMOOTHING)], rows)
    return Made(tables)


def odometry(_: Data) -> Made:
    """How exact the motions of the camera are."""
    tables = {
        "compared": odometries.compared(),
        "poses": odometries.with_poses(),
        "projector": odometries.under_a_projector(),
    }
    return Made(tables)


def cameras(data: Data) -> Made:
    """Which errors the depth of rendered and of real cameras has."""
    real = {name: data.of_camera(name) for name in ("d435-arm", "kitti")}
    return Made({"errors": camera_errors.errors_of_cameras((*GROUPS["artefacts"], "sim-LN"), real)})


def learned(data: Data) -> Made:
    """How many pixels of real cameras the network fills right."""
    rows: list[list[Value]] = []
    evaluation = _evaluated(_recorded(data, REAL), [*BASELINES, WHOLE, "learned"], REAL_FRAMES, data)
    for shares in evaluation.shares:
        for kind in shares.kinds.values():
            best = next(method for method in kind.ranked if method in BASELINES)
            values = [f"{100 * kind.share(method).value:.1f}" for method in (WHOLE, "learned", best)]
            rows.append([f"{shares.recording}, {kind.title}", *values[:2], f"{values[2]} `{best}`"])
    return Made({"real": Table.of(RIGHT, ["pixels", "default [%]", "learned [%]", "best baseline [%]"], rows)})


def _recorded(data: Data, names: Sequence[str]) -> list[EvaluationSequence]:
    opener = Opener(None, 20.0, 0, units_per_m=None, depth_topic=None, gray_topic=None)
    folders = [data.of_camera(name) for name in names]
    return [requested for folder in folders for requested in requested_of(folder, opener)]


def _evaluated(requested: Sequence[EvaluationSequence], methods: Sequence[str], frames: int, data: Data) -> Evaluation:
    restrict_opencv()
    plan = Plan(sequences=requested, methods=find_methods(methods), frames=frames, out=data.out / "evaluation")
    evaluation = evaluate(plan, lambda what, done: print(f"\r{what}; {done} of {len(plan)} done", end="", flush=True))
    print()
    for failed in evaluation.failures:
        raise MissingDataError(f"{failed.method} on {failed.sequence}, which failed: {failed.error}")
    return evaluation


def _best_other(kind: PixelKind) -> str:
    return next(method for method in kind.ranked if method != WHOLE)


def _two_shares(kind: PixelKind, other: str) -> list[str]:
    return [f"{100 * kind.share(WHOLE).value:.1f}", f"{100 * kind.share(other).value:.1f} `{other}`"]


def _points(kind: PixelKind, method: str, other: str) -> str:
    """The lead of a method over another one in points, with its interval."""
    return kind.lead(method, other).scaled(100).text("+.1f")


def _part(name: str) -> str:
    """What a method lacks: a part by its name, or what a setting switches off."""
    return f"`{name.removeprefix(f'{WHOLE}[').removeprefix('without=').removesuffix(']')}`"
