"""The measures of the artefacts of raw depth, on images whose artefacts are known."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.experiments.artefacts import Artefacts, bends, compare_artefacts, islands, measured, shadows
from scenarios.experiments.runner import RunOptions, create_context, find_experiments
from tests.experiment_context import small_context
from voxdepth.types import Frame, Intrinsics

CAMERA = Intrinsics(fx_px=400, fy_px=400, cx_px=100, cy_px=50, width_px=200, height_px=100, baseline_m=0.05)
FAR_PX, NEAR_PX = 5.0, 25.0


def stepped(width_px: int, *, mirrored: bool = False) -> np.ndarray:
    """Disparity of a near surface on the right of the image, with a hole of some width on its left."""
    disparity_px = np.full(CAMERA.shape, FAR_PX, np.float32)
    disparity_px[:, 120:] = NEAR_PX
    disparity_px[:, 120 - width_px : 120] = 0
    return disparity_px[:, ::-1] if mirrored else disparity_px


def depth_of(disparity_px: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        depth_m = np.float32(20) / disparity_px
    return np.where(disparity_px > 0, depth_m, 0).astype(np.float32)


@pytest.mark.parametrize(("width_px", "ratio"), [(20, 1.0), (26, 1.3)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_shadows_are_measured_in_steps_on_either_side(width_px: int, ratio: float, mirrored: bool) -> None:
    found = Artefacts()
    found.add(depth_of(stepped(width_px, mirrored=mirrored)), CAMERA)
    values = found.values("x", CAMERA)
    assert values[2] == pytest.approx(width_px / 2)
    assert values[3] == pytest.approx(ratio, rel=1e-5)
    assert values[4] == (0 if mirrored else 100)
    assert values[5:8] == (0, 0, 0), "straight rims and no islands"
    assert values[9] == 100 * width_px


def test_holes_within_one_surface_and_at_the_border_are_no_shadows() -> None:
    disparity_px = np.full(CAMERA.shape, FAR_PX, np.float32)
    disparity_px[20:30, 50:80], disparity_px[:, :15] = 0, 0
    assert len(shadows(disparity_px)[0]) == 0


def test_a_straight_edge_has_no_bends_however_slanted_and_a_zigzag_has() -> None:
    row = np.arange(50)
    for slope in (0, 1, -3):
        assert bends((50, 400), row, 200 + slope * row).sum() == 0
    zigzag = bends((50, 400), row, 200 + 2 * (row % 2))
    assert (len(zigzag), zigzag.min(), zigzag.max()) == (48, 4, 4)


def test_islands_are_counted_by_their_size() -> None:
    disparity_px = stepped(40)
    disparity_px[10, 90] = FAR_PX
    disparity_px[20:23, 90:93] = 12
    disparity_px[40:48, 30:38] = 50
    np.testing.assert_array_equal(islands(disparity_px), [1, 0, 0, 0, 9, 0])


def test_flicker_counts_pixels_of_a_still_camera_alone() -> None:
    gray = np.random.default_rng(0).integers(0, 255, CAMERA.shape, dtype=np.uint8)
    whole, holed = depth_of(stepped(20)), depth_of(stepped(22))
    frames = [Frame(stamp_s=float(k), gray=gray, depth_m=depth) for k, depth in enumerate((whole, holed, holed))]
    assert measured(frames, CAMERA).values("x", CAMERA)[10] == pytest.approx(100 * 2 / (2 * CAMERA.width_px))
    moved = [frames[0], Frame(stamp_s=1.0, gray=np.roll(gray, 40, axis=1), depth_m=holed)]
    assert measured(moved, CAMERA).values("x", CAMERA)[10] is None


def test_recordings_of_cameras_are_measured_beside_sequences(tmp_path: Path) -> None:
    folder = tmp_path / "camera"
    for name in ("depth", "color"):
        (folder / name).mkdir(parents=True)
    depth_mm = np.rint(1000 * depth_of(stepped(26))).astype(np.uint16)
    cv2.imwrite(str(folder / "depth/000000.png"), depth_mm)
    cv2.imwrite(str(folder / "color/000000.png"), np.zeros(CAMERA.shape, np.uint8))
    text = "\n".join(f"{name} = {json.dumps(value)}" for name, value in vars(CAMERA).items())
    (folder / "calibration.toml").write_text(text)
    context = small_context(tmp_path / "out", 2)
    findings = compare_artefacts(context.__class__(**vars(context) | {"data": (folder,)}))
    (table,) = findings.tables
    assert table.column("sequence") == ["sim-MB", "camera"]
    assert table.column("shadow width")[1] == pytest.approx(1.3, rel=0.01)
    assert findings.figure.startswith(b"\x89PNG")


def test_other_experiments_refuse_recordings(tmp_path: Path) -> None:
    (rq1,) = find_experiments(["rq1"])
    with pytest.raises(ScenarioError, match="rq1 reads no recordings"):
        create_context(rq1, RunOptions(out=tmp_path, data=(tmp_path,)), lambda what: None)
