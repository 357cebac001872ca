"""Stereo recordings on disk, with the true depth and pose of every frame.

A recording is a folder. Frame 7 consists of the images `gray_left/000007.png`, `gray_right`, `depth_raw`, `depth_true`,
`occluded`, `segment` and `invalid_reason` with that name, and of row 7 of `frames.csv`, which holds its time and its
pose. The writer adds the row after the images: whatever stops it, a frame with a row is complete.
"""

from .format import CALIBRATION, Recording, calibration_toml
from .writer import RecordingWriter

__all__ = ["CALIBRATION", "Recording", "RecordingWriter", "calibration_toml"]
