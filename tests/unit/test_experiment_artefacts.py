"""The measures of the artefacts of raw depth, on images whose artefacts are known."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenarios.experiments import artefacts
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


def row_of(*disparities_px: np.ndarray) -> dict[str, float]:
    """The artefacts of images of one camera."""
    gray = np.zeros(CAMERA.shape, np.uint8)
    frames = [Frame(stamp_s=k, gray=gray, depth_m=depth_of(each)) for k, each in enumerate(disparities_px)]
    return artefacts.measured(frames, CAMERA)


@pytest.mark.parametrize(("width_px", "ratio"), [(20, 1.0), (26, 1.3)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_shadows_are_measured_in_steps_on_either_side(width_px: int, ratio: float, mirrored: bool) -> None:
    row = row_of(stepped(width_px, mirrored=mirrored))
    assert row[artefacts.HOLES] == pytest.approx(width_px / 2)
    assert row[artefacts.RATIO] == pytest.approx(ratio, rel=1e-5)
    assert row[artefacts.LEFT] == (0 if mirrored else 100)
    assert row[artefacts.RIM] == row[artefacts.ISLANDS] == 0


def test_holes_within_one_surface_and_at_the_border_are_no_shadows() -> None:
    disparity_px = np.full(CAMERA.shape, FAR_PX, np.float32)
    disparity_px[20:30, 50:80], disparity_px[:, :15] = 0, 0
    assert len(artefacts.shadows(disparity_px)[0]) == 0


def test_a_straight_edge_has_no_bends_however_slanted_and_a_zigzag_has() -> None:
    row = np.arange(50)
    for slope in (0, 1, -3):
        assert artefacts.bends((50, 400), row, 200 + slope * row).sum() == 0
    zigzag = artefacts.bends((50, 400), row, 200 + 2 * (row % 2))
    assert (len(zigzag), zigzag.min(), zigzag.max()) == (48, 4, 4)


def test_islands_are_counted_by_their_size() -> None:
    disparity_px = stepped(40)
    disparity_px[10, 90] = FAR_PX
    disparity_px[20:23, 90:93] = 12
    disparity_px[40:48, 30:38] = 50
    np.testing.assert_array_equal(artefacts.islands(disparity_px), [1, 0, 0, 0, 9, 0])
    row = row_of(disparity_px, stepped(40))
    assert row[artefacts.ISLANDS] == pytest.approx(1e4 * (1 + 9 / 12) / (2 * 200 * 100)), "9 to 16 px: 12 on average"


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
    findings = artefacts.artefacts.answer(context.__class__(**vars(context) | {"data": (folder,)}))
    table = findings.table.set_index("sequence")
    assert list(table.index) == ["sim-MB", "camera"]
    assert table.loc["camera", artefacts.RATIO] == pytest.approx(1.3, rel=0.01)
    assert findings.figure.startswith(b"\x89PNG")
