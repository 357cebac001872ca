"""How exact the odometries are, printed by `make bench`.

`voxdepth/paper/odometry.py` states the figures of the paper's one, and `docs/corrector.md` those of the default method.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from functools import cache, lru_cache
from itertools import islice, pairwise, permutations
from typing import NamedTuple

import cv2
import numpy as np
import pytest

from scenarios.sequences import SeededSequence, load_sequence, simulation
from sim.render.raycast import open3d
from sim.types import Capture
from swarm.perception import frame_of
from tests.bench.test_speed import show
from voxdepth.geometry import exp_se3
from voxdepth.paper import odometry as paper
from voxdepth.paper.odometry import (
    MAX_DEPTH_DIFFERENCE_M,
    MAX_DEPTH_M,
    MAX_WIDTH_PX,
    OPENCV_DEPTH_UNITS_PER_M,
    Comparison,
    PhotometricOdometry,
    _opencv_images,
    _opencv_solver,
    motion_of_priors,
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
    kinds: tuple[str, ...] = ()

    def truth(self) -> FloatArray:
        return motion_of_priors(self.source, self.target)

    def error_mm(self, T: FloatArray) -> float:
        return 1e3 * float(np.linalg.norm(T[:3, 3] - self.truth()[:3, 3]))

    def comparison(self) -> Comparison:
        return Comparison(view_of(self.source, REDUCED), view_of(self.target, REDUCED), REDUCED)


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


@lru_cache(maxsize=2)
def spoilt(gain: float, holes: float, noise_gray: float) -> list[list[Frame]]:
    """The films at another exposure, with more holes and more noise."""
    rng = np.random.default_rng(round(100 * gain))

    def spoil(frame: Frame) -> Frame:
        gray = np.rint(frame.gray * gain + noise_gray * rng.standard_normal(CAMERA.shape)).clip(0, 255)
        depth_m = np.where(rng.random(CAMERA.shape) < holes, np.float32(0), frame.depth_m)
        return replace(frame, gray=gray.astype(np.uint8), depth_m=depth_m)

    return [[spoil(frame) for frame in film] for film in films()]


def good_pairs(holes: float = 0.15, noise_gray: float = 0.0) -> list[Pair]:
    sources, targets = (spoilt(gain, holes, noise_gray) for gain in GAINS)
    return [
        Pair(a[i], b[i + step], ("all pairs", f"{step} frames", SEQUENCES[film // len(PLACES)]))
        for step in STEPS
        for film, (a, b) in enumerate(zip(sources, targets, strict=True))
        for i in range(FRAMES - step)
    ]


def bad_pairs() -> list[Pair]:
    """Of different places: the first, middle and last frames of their films."""
    both = zip(*(spoilt(gain, 0.15, 0.0) for gain in GAINS), strict=True)
    return [Pair(a[i], b[i]) for (a, _), (_, b) in permutations(both, 2) for i in (0, 3, 6)]


def estimates(pairs: list[Pair]) -> list[tuple[Pair, FloatArray | None]]:
    odometry = PhotometricOdometry(CAMERA)
    return [(pair, odometry.estimate(pair.source, pair.target)) for pair in pairs]


def span(values: list[float]) -> str:
    """Least, median and greatest."""
    return " / ".join(f"{x:.2f}" for x in np.percentile(values, [0, 50, 100])) if values else "-"


def test_error_by_step_and_sequence() -> None:
    print()
    done = estimates(good_pairs())
    for kind in ("all pairs", *(f"{step} frames" for step in STEPS), *SEQUENCES):
        chosen = [(pair, T) for pair, T in done if kind in pair.kinds]
        errors_mm = [pair.error_mm(T) for pair, T in chosen if T is not None]
        longest_m = max(float(np.linalg.norm(pair.truth()[:3, 3])) for pair, _ in chosen)
        figure = f"error p50 {np.median(errors_mm):5.1f} mm, largest {max(errors_mm):5.1f} mm"
        show(f"{kind}, up to {longest_m:.2f} m", f"{len(errors_mm):3} of {len(chosen):3} solved, {figure}")


@pytest.mark.parametrize(("holes", "noise_gray"), [(0.15, 0), (0.5, 0), (0.15, 5)])
def test_what_the_images_say_of_estimates(holes: float, noise_gray: float, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(paper, "MAX_RESIDUAL_PX", 1e9)
    monkeypatch.setattr(paper, "MIN_OVERLAP", 0)
    done = estimates(good_pairs(holes, noise_gray))
    for kind, far in (("within", False), ("beyond", True)):
        found = [(pair.comparison(), T) for pair, T in done if T is not None and (pair.error_mm(T) > 50) == far]
        residuals_px, overlaps = ([getattr(c, name)(T) for c, T in found] for name in ("residual_px", "overlap"))
        figure = f"{len(found):3} of {len(done)}, residual_px {span(residuals_px)}, overlap {span(overlaps)}"
        show(f"estimates {kind} 50 mm, {holes:.0%} more holes, {noise_gray} gray levels of noise", figure)


@pytest.mark.parametrize(("offset_mm", "turn_mrad"), [(50, 0), (100, 0), (0, 10)])
def test_what_the_images_say_of_falsified_motions(offset_mm: float, turn_mrad: float) -> None:
    T = np.eye(4)
    T[:3, :3], T[0, 3] = cv2.Rodrigues(np.array([0, turn_mrad / 1e3, 0]))[0], offset_mm / 1e3
    found = [pair.comparison().residual_px(T @ pair.truth()) for pair in good_pairs()]
    figure = f"{len(found):3}, residual_px {span([residual_px for residual_px in found if residual_px is not None])}"
    show(f"true motions falsified by {offset_mm} mm, {turn_mrad} mrad", figure)


def drifting(film: list[Frame], seed: int) -> list[Frame]:
    """A film with the poses of an odometry that is off by 6 mm per axis and 0.03 degrees from frame to frame."""
    rng, drift, drifted = np.random.default_rng(seed), np.eye(4), []
    for frame in film:
        drift = drift @ exp_se3(np.repeat([0.006, np.radians(0.03)], 3) * rng.standard_normal(6))
        drifted.append(replace(frame, T_world_cam=frame.T_world_cam @ drift))
    return drifted


def beside_a_wall(frame: Frame, visible: float) -> Frame:
    """A frame of which only a part at the left has texture and depth."""
    col, gray, depth_m = round(visible * CAMERA.width_px), frame.gray.copy(), frame.depth_m.copy()
    gray[:, col:], depth_m[:, col:] = 90, 0
    return replace(frame, gray=gray, depth_m=depth_m)


def motions_of_the_default(film: list[Frame]) -> list[FloatArray | None]:
    """The motion of the camera to each frame but the first; None where the default method does not find it."""
    corrector = TemporalCorrector(CAMERA)
    found = [corrector.process(frame).diagnostics for frame in film]
    return [one.T_frame_keyframe for one in found[1:] if isinstance(one, TrackingResult)]


@pytest.mark.parametrize("visible", [1.0, 0.25, 0.1])
def test_poses_of_the_caller(visible: float) -> None:
    errors_mm: dict[str, list[float]] = defaultdict(list)
    for seed, film in enumerate(films()):
        seen = [beside_a_wall(frame, visible) for frame in film]
        said = drifting(seen, seed)
        motions = {
            "images": motions_of_the_default([replace(frame, T_world_cam=None) for frame in seen]),
            "poses of the caller": [Pair(*two).truth() for two in pairwise(said)],
            "both": motions_of_the_default(said),
        }
        for kind, found in motions.items():
            for T, two in zip(found, pairwise(film), strict=True):
                if T is not None:
                    errors_mm[kind].append(1e3 * float(np.linalg.norm((T - Pair(*two).truth())[:3, 3])))
    for kind, values in errors_mm.items():
        figure = f"error p50 {np.median(values):5.1f} mm, p90 {np.percentile(values, 90):5.1f} mm, {len(values)} frames"
        show(f"{visible:.0%} of the image with texture, {kind}", figure)


@pytest.mark.parametrize("strength", [None, 0.5, 1.5])
def test_dots_of_a_projector(strength: float | None) -> None:
    """Errors of the default method's motion where the gray image shows dots that stay where they are in the image."""
    sequence = load_sequence("sim-MB", 0, RIG | ({"rig.projected_texture": strength} if strength else {}))
    film = [frame_of(seen, seen.T_world_cam) for seen in captures(sequence, 40, start=20)]
    truths = [Pair(*two).truth()[:3, 3] for two in pairwise(film)]
    found = motions_of_the_default([replace(frame, T_world_cam=None) for frame in film])
    errors_mm = [1e3 * np.linalg.norm(T[:3, 3] - t) for T, t in zip(found, truths, strict=True) if T is not None]
    moved_mm = 1e3 * np.median([np.linalg.norm(t) for t in truths])
    figure = f"error p50 {np.median(errors_mm):4.1f} of {moved_mm:.0f} mm, {len(errors_mm)} of {len(truths)} solved"
    show(f"dots of a projector, strength {strength}", figure)


def test_pairs_of_different_places(monkeypatch: pytest.MonkeyPatch) -> None:
    accepted = sum(T is not None for _, T in estimates(bad_pairs()))
    monkeypatch.setattr(paper, "MAX_RESIDUAL_PX", 1e9)
    found = [(pair.comparison(), T) for pair, T in estimates(bad_pairs()) if T is not None]
    figure = f"{accepted:3} of {len(bad_pairs())} accepted, residual_px {span([c.residual_px(T) for c, T in found])}"
    show("pairs of different places", figure)


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
