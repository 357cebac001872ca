"""Drawn images and frames, and what two results have in common. Nothing here needs the testbed."""

import re
from pathlib import Path

import cv2
import numpy as np

from voxdepth.geometry import PointArray
from voxdepth.types import CorrectedDepth, FloatImage, Frame, GrayImage, Intrinsics


def textured(
    shape: tuple[int, int], seed: int = 0, *, blur_px: float = 1.5, darkest: int = 0, brightest: int = 255
) -> GrayImage:
    """A gray image with many corners: the more it is blurred, the fewer."""
    noise = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    blurred = cv2.GaussianBlur(noise, (0, 0), blur_px)
    return np.asarray(cv2.normalize(blurred, None, darkest, brightest, cv2.NORM_MINMAX), np.uint8)


def walk(n: int, camera: Intrinsics) -> list[Frame]:
    """A textured wall at 4 m that passes by one pixel a frame, with noise and new holes in every frame."""
    rng, wide, frames = np.random.default_rng(0), textured((camera.height_px, 2 * camera.width_px)), []
    for i in range(n):
        depth_m = rng.normal(4.0, 0.02, camera.shape).astype(np.float32)
        depth_m[rng.random(camera.shape) < 0.1] = 0
        depth_m[40:60, 70:90] = 0
        gray = np.ascontiguousarray(wide[:, i : i + camera.width_px])
        frames.append(Frame(stamp_s=0.1 * i, gray=gray, depth_m=depth_m))
    return frames


def promised_entities(recording: str) -> set[str]:
    """The entities of a recording that the tutorial of the paper names in its table of that file."""
    tutorial = (Path(__file__).parents[1] / "docs/tutorials/rerun_the_paper.md").read_text()
    _, _, table = tutorial.partition(f"| entity in `{recording}` |")
    rows = [row for row in table.partition("\n\n")[0].splitlines() if row.startswith("| `")]
    return {entity for row in rows for entity in re.findall(r"`([^`]+)`", row.split("|")[1])}


def project_nearest(points: PointArray, intrinsics: Intrinsics) -> FloatImage:
    """Depth image [m], shape (H, W), float32, of points (N, 3) [m] in the camera frame; 0 where none falls.

    A point takes the one pixel that its projection rounds to.
    """
    depth_m = np.full(intrinsics.shape, np.inf, np.float32)
    x, y, z = points[points[:, 2] > 0].T
    half = np.float32(0.5)
    col = np.floor(x / z * np.float32(intrinsics.fx_px) + np.float32(intrinsics.cx_px) + half)
    row = np.floor(y / z * np.float32(intrinsics.fy_px) + np.float32(intrinsics.cy_px) + half)
    inside = (col >= 0) & (col < intrinsics.width_px) & (row >= 0) & (row < intrinsics.height_px)
    np.minimum.at(depth_m, (row[inside].astype(np.intp), col[inside].astype(np.intp)), z[inside])
    depth_m[np.isinf(depth_m)] = 0
    return depth_m


def require_equal(got: CorrectedDepth, want: CorrectedDepth) -> None:
    """Assert that two results have the same images and the same diagnostics."""
    for image in ("depth_m", "source", "confidence"):
        np.testing.assert_array_equal(getattr(got, image), getattr(want, image))
    assert (got.diagnostics is None) == (want.diagnostics is None)
    assert got.diagnostics is None or got.diagnostics.facts() == want.diagnostics.facts()
