"""How exact the odometries are, in rendered sequences; `tests.results` makes tables of it."""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import islice, pairwise, permutations
from typing import NamedTuple

import numpy as np

from scenarios.sequences import SeededSequence, load_sequence, simulation
from sim.render.raycast import open3d
from sim.types import Capture
from swarm.perception import frame_of
from voxdepth.geometry import inverse_rigid, retract
from voxdepth.paper.odometry import (
    MAX_DEPTH_DIFFERENCE_M,
    MAX_DEPTH_M,
    MAX_WIDTH_PX,
    OPENCV_DEPTH_UNITS_PER_M,
    PhotometricOdometry,
    _opencv_images,
    _opencv_solver,
    view_of,
)
from voxdepth.temporal.method import TemporalCorrector
from voxdepth.temporal.odometry import TrackingStatus
from voxdepth.tools.results.table import Table, Value
from voxdepth.types import FloatArray, Frame, Intrinsics

CAMERA = Intrinsics.from_hfov(width_px=640, height_px=360, hfov_deg=86.0)
RIG = {"rig.width_px": 640, "rig.height_px": 360, "rig.hfov_deg": 86.0, "rig.baseline_m": 0.095}
SEQUENCES = ("sim-MB", "sim-KTS", "sim-PLW")
"""A walk along facades, and flights over sunny ground and over snow; each of another seed, so that no two are alike."""
PLACES, FRAMES = (20, 150, 280), 7
"""Frames at which a short film of each sequence begins, metres apart, and how many it has."""
STEPS = (1, 2, 4, 6)
"""Frames from the first to the second of a pair."""
GAINS = (1.0, 1.1)
"""Exposure of the first and of the second frame of a pair."""
REDUCED = CAMERA.reduced(MAX_WIDTH_PX)


class Pair(NamedTuple):
    source: Frame
    target: Frame

    def truth(self) -> FloatArray:
        return inverse_rigid(self.target.T_world_cam) @ self.source.T_world_cam


def captures(seeded: SeededSequence, frames: int, *, start: int) -> list[Capture]:
    """The captures of a sequence from frame `start` up to `frames`, without files."""
    with simulation(seeded) as simulated:
        pairs = islice(simulated.render(frames), start, None)
        return [simulated.sensor.capture(pair) for pair in pairs]


@cache
def films() -> list[list[Frame]]:
    """Gray images with the photon noise of the rig, depth by stereo matching, and the true pose."""
    return [
        [frame_of(seen, seen.T_world_cam) for seen in captures(load_sequence(name, seed, RIG), at + FRAMES, start=at)]
        for seed, name in enumerate(SEQUENCES)
        for at in PLACES
    ]


@cache
def spoilt(gain: float) -> list[list[Frame]]:
    """The films at another exposure, with 15 % more holes."""
    rng = np.random.default_rng(round(100 * gain))

    def spoil(frame: Frame) -> Frame:
        gray = np.rint(frame.gray * gain).clip(0, 255).astype(np.uint8)
        return replace(frame, gray=gray, depth_m=np.where(rng.random(CAMERA.shape) < 0.15, 0, frame.depth_m))

    return [[spoil(frame) for frame in film] for film in films()]


def good_pairs() -> list[Pair]:
    both = zip(*(spoilt(gain) for gain in GAINS), strict=True)
    return [Pair(a[i], b[i + step]) for a, b in both for step in STEPS for i in range(FRAMES - step)]


def bad_pairs() -> list[Pair]:
    """Of different scenes: the first, middle and last frames of their films."""
    both = zip(*(spoilt(gain) for gain in GAINS), strict=True)
    return [Pair(a[i], b[i]) for (a, _), (_, b) in permutations(both, 2) for i in (0, 3, 6)]


def motions_of_the_default(film: list[Frame]) -> list[FloatArray | None]:
    """The motion of the camera to each frame but the first; None where the default method does not find it.

    After a frame whose motion is not known, the next one is told from an earlier view.
    """
    corrector = TemporalCorrector(CAMERA)
    found = [corrector.process(frame).diagnostics for frame in film]
    known = (TrackingStatus.FIRST_FRAME, TrackingStatus.OK)
    return [now.T_frame_keyframe if before.status in known else None for before, now in pairwise(found)]


Found = FloatArray | None
"""Maps points of the source camera into the target camera, shape (4, 4); None if the motion was not found."""


def by_ours(pair: Pair) -> Found:
    return PhotometricOdometry(CAMERA).estimate(pair.source, pair.target)


def by_the_default_method(pair: Pair) -> Found:
    return motions_of_the_default([replace(pair[i], T_world_cam=None, stamp_s=0.1 * i) for i in range(2)])[0]


def by_opencv(pair: Pair) -> Found:
    before, after = (_opencv_images(view_of(frame, REDUCED), REDUCED) for frame in pair[:2])
    solved, T = _opencv_solver(REDUCED).compute(before[1], before[0], after[1], after[0])
    return np.asarray(T, np.float64) if solved else None


def by_open3d(pair: Pair) -> Found:
    """By gray values, with three scales."""
    o3d, tensor = open3d(), open3d().core.Tensor
    odometry, camera = o3d.t.pipelines.odometry, REDUCED
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    images = []
    for frame in pair[:2]:
        gray, units = _opencv_images(view_of(frame, camera), camera)
        both = np.repeat(gray[..., None], 3, axis=2), units[..., None]
        images.append(o3d.t.geometry.RGBDImage(*(o3d.t.geometry.Image(tensor(array)) for array in both)))
    try:
        found = odometry.rgbd_odometry_multi_scale(
            *images, tensor(matrix), tensor(np.eye(4)), OPENCV_DEPTH_UNITS_PER_M, MAX_DEPTH_M,
            [odometry.OdometryConvergenceCriteria(n) for n in (20, 10, 5)], odometry.Method.Intensity,
            odometry.OdometryLossParams(MAX_DEPTH_DIFFERENCE_M),
        )  # fmt: skip
    except RuntimeError as error:
        assert "tracking failed" in str(error)
        return None
    return found.transformation.numpy() if found.fitness > 0 else None


ODOMETRIES: dict[str, Callable[[Pair], Found]] = {
    "`voxdepth`": by_ours,
    "tracked corners of `temporal`, its whole frames": by_the_default_method,
    "OpenCV, `cv2.Odometry`": by_opencv,
    "Open3D, `rgbd_odometry_multi_scale`": by_open3d,
}


def compared() -> Table:
    """How exact the paper's odometry, that of the default method and two others are, all at the size of the first."""
    pairs, wrong = good_pairs(), bad_pairs()
    rows: list[list[Value]] = []
    for name, odometry in ODOMETRIES.items():
        odometry(pairs[0])
        start_s = time.process_time()
        found = [odometry(pair) for pair in pairs]
        spent_ms = 1e3 * (time.process_time() - start_s) / len(pairs)
        errors_mm = [_apart_mm(T, pair) for pair, T in zip(pairs, found, strict=True) if T is not None]
        accepted = sum(odometry(pair) is not None for pair in wrong)
        p50, p95, most = (f"{value:.1f}" for value in np.percentile(errors_mm, [50, 95, 100]))
        rows.append([name, len(errors_mm), accepted, p50, p95, most, f"{spent_ms:.0f}"])
    title = f"Motions of {len(pairs)} pairs of frames, and of {len(wrong)} pairs that show different places"
    headings = [
        "odometry",
        "solved",
        "wrong pairs accepted",
        "error p50 [mm]",
        "p95 [mm]",
        "largest [mm]",
        "CPU time [ms]",
    ]
    return Table.of(title, headings, rows)


def with_poses() -> Table:
    """Errors of the motion from frame to frame by the images, by the poses of the caller, and by both."""
    rows: list[list[Value]] = []
    for visible in (1.0, 0.25, 0.1):
        errors_mm: dict[str, list[float]] = defaultdict(list)
        for seed, film in enumerate(films()):
            seen = [beside_a_wall(frame, visible) for frame in film]
            said = drifting(seen, seed)
            motions = {
                "the images": motions_of_the_default([replace(frame, T_world_cam=None) for frame in seen]),
                "the poses": [Pair(*two).truth() for two in pairwise(said)],
                "both": motions_of_the_default(said),
            }
            for kind, found in motions.items():
                pairs = zip(found, map(Pair._make, pairwise(film)), strict=True)
                errors_mm[kind] += [_apart_mm(T, pair) for T, pair in pairs if T is not None]
        for kind, values in errors_mm.items():
            p50, p90 = (f"{value:.1f}" for value in np.percentile(values, [50, 90]))
            rows.append([f"{visible:.0%}", kind, len(values), p50, p90])
    title = "Error of the motion from frame to frame, where a share of the image has texture and depth"
    return Table.of(title, ["share of the image", "motion by", "solved", "error p50 [mm]", "p90 [mm]"], rows)


def under_a_projector() -> Table:
    """Errors of the default method's motion where the gray image shows dots that stay where they are in the image."""
    rows: list[list[Value]] = []
    for name, strength in {"none": None, "weak": 0.5, "strong": 1.5}.items():
        sequence = load_sequence("sim-MB", 0, RIG | ({"rig.projected_texture": strength} if strength else {}))
        film = [frame_of(seen, seen.T_world_cam) for seen in captures(sequence, 40, start=20)]
        pairs = [Pair(*two) for two in pairwise(film)]
        found = motions_of_the_default([replace(frame, T_world_cam=None) for frame in film])
        errors_mm = [_apart_mm(T, pair) for T, pair in zip(found, pairs, strict=True) if T is not None]
        moved_mm = 1e3 * np.median([np.linalg.norm(pair.truth()[:3, 3]) for pair in pairs])
        solved = f"{len(errors_mm)} of {len(pairs)}"
        rows.append([name, solved, f"{moved_mm:.0f}", f"{np.median(errors_mm):.1f}"])
    title = "Motion of the default method from frame to frame in `sim-MB` under the dots of a projector"
    return Table.of(title, ["dots", "solved", "moved p50 [mm]", "error p50 [mm]"], rows)


def _apart_mm(T_target_source: FloatArray, pair: Pair) -> float:
    return 1e3 * float(np.linalg.norm((T_target_source - pair.truth())[:3, 3]))


def drifting(film: list[Frame], seed: int) -> list[Frame]:
    """A film with the poses of an odometry that is off by 6 mm per axis and 0.03 degrees from frame to frame."""
    rng, drift, drifted = np.random.default_rng(seed), np.eye(4), []
    for frame in film:
        step = np.repeat([0.006, np.radians(0.03)], 3) * rng.standard_normal(6)
        drift = drift @ retract(step)
        drifted.append(replace(frame, T_world_cam=frame.T_world_cam @ drift))
    return drifted


def beside_a_wall(frame: Frame, visible: float) -> Frame:
    """A frame of which only a part at the left has texture and depth."""
    col, gray, depth_m = round(visible * CAMERA.width_px), frame.gray.copy(), frame.depth_m.copy()
    gray[:, col:], depth_m[:, col:] = 90, 0
    return replace(frame, gray=gray, depth_m=depth_m)
