"""A contact sheet of a recording: gray image, true and raw depth, occlusion and reasons for holes of a few frames."""

from pathlib import Path

import numpy as np

from sim.recording import Recording
from sim.types import Capture, InvalidReason

from .errors import ScenarioError
from .images import (
    INVALID_REASON_COLORS_BGR,
    Image,
    color_invalid_reasons,
    colored,
    gray_bgr,
    narrowed,
    picked,
    require_picture,
    save_picture,
    titled,
)

PANEL_PX = 300
ROWS = 3
GAP_PX = 6


def make_sheet(folder: Path, out: Path) -> None:
    """Write the contact sheet of a recording.

    Raises:
        RecordingError: The recording cannot be read.
        ScenarioError: The recording has no frame, or the picture cannot be written.
    """
    require_picture(out)
    recording = Recording.open(folder)
    if len(recording) == 0:
        raise ScenarioError(f"{folder} holds no complete frame: record some first")
    frames = np.unique(np.linspace(0, len(recording) - 1, ROWS).round().astype(int))
    rows = [_row(recording[int(frame)], int(frame)) for frame in frames]
    save_picture(out, np.vstack([*rows, _legend(rows[0].shape[1])]))


def _row(capture: Capture, frame: int) -> Image:
    panels = {
        f"gray, frame {frame}": narrowed(gray_bgr(capture.gray_left), PANEL_PX),
        "depth, true": colored(picked(capture.depth_true_m, PANEL_PX)),
        "depth, raw": colored(picked(capture.depth_raw_m, PANEL_PX)),
        "hidden from the right camera": color_invalid_reasons(
            picked(capture.occluded * np.uint8(InvalidReason.OCCLUDED), PANEL_PX)
        ),
        "why there is no depth": color_invalid_reasons(picked(capture.invalid_reason, PANEL_PX)),
    }
    return np.hstack([_spaced(titled(name, image)) for name, image in panels.items()])


def _spaced(image: Image) -> Image:
    gaps = ((0, GAP_PX), (0, GAP_PX), (0, 0))
    padded: Image = np.pad(image, gaps, constant_values=245)
    return padded


def _legend(width_px: int) -> Image:
    """One coloured field with a title per reason."""
    n = len(INVALID_REASON_COLORS_BGR)
    fields = []
    for k, (reason, color) in enumerate(INVALID_REASON_COLORS_BGR.items()):
        field = np.full((12, (k + 1) * width_px // n - k * width_px // n, 3), color, np.uint8)
        fields.append(titled(reason.name.lower().replace("_", " "), field))
    return np.hstack(fields)
