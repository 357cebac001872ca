"""How exact the odometries are, printed by `make bench`; `docs/paper.md` states the figures."""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import islice, permutations
from typing import NamedTuple

import numpy as np
import pytest

from scenarios.sequences import SeededSequence, load_sequence, simulation
from sim.render.raycast import open3d
from sim.types import Capture
from swarm.perception import frame_of
from tests.bench.test_speed import show
from voxdepth.geometry import inverse_rigid
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
from voxdepth.temporal.odometry import TrackingResult
from voxdepth.types import FloatArray, Frame, Intrinsics

pytestmark = pytest.mark.bench

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
    """Of different places: the first, middle and last frames of their films."""
    both = zip(*(spoilt(gain) for gain in GAINS), strict=True)
    return [Pair(a[i], b[i]) for (a, _), (_, b) in permutations(both, 2) for i in (0, 3, 6)]


def motions_of_the_default(film: list[Frame]) -> list[FloatArray | None]:
    """The motion of the camera to each frame but the first; None where the default method does not find it."""
    corrector = TemporalCorrector(CAMERA)
    found = [corrector.process(frame).diagnostics for frame in film]
    return [one.T_frame_keyframe for one in found[1:] if isinstance(one, TrackingResult)]


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


@pytest.mark.parametrize("odometry", [by_ours, by_the_default_method, by_opencv, by_open3d])
def test_odometries_of_others(odometry: Callable[[Pair], Found]) -> None:
    """All at the size of ours."""
    pairs, wrong = good_pairs(), bad_pairs()
    odometry(pairs[0])
    start_s = time.process_time()
    found = [odometry(pair) for pair in pairs]
    spent_ms = 1e3 * (time.process_time() - start_s) / len(pairs)
    errors_mm = [
        1e3 * np.linalg.norm((T - p.truth())[:3, 3]) for p, T in zip(pairs, found, strict=True) if T is not None
    ]
    accepted = sum(odometry(pair) is not None for pair in wrong)
    p50, p95, most = np.percentile(errors_mm, [50, 95, 100])
    figure = f"error p50 {p50:.1f}, p95 {p95:.1f}, largest {most:.0f} mm, CPU mean {spent_ms:.1f} ms"
    solved = f"{len(errors_mm)} of {len(pairs)} solved, {accepted} of {len(wrong)} wrong ones accepted"
    show(odometry.__name__, f"{solved}, {figure}")
