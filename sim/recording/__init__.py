"""Stereo recordings with truth, on disk: what is true of every frame beside what the camera measured.

A recording is a folder. Frame 7 is the images `gray_left/000007.png`, `gray_right`, `depth_raw`, `depth_true`,
`occluded`, `segment` and `invalid_reason` of that name, a line of `groundtruth.txt` and its lines of
`checksums.txt`. The checksums come last and are the commit of the frame: whatever stops the
writer, all frames before are whole.
"""

from .reader import Recording
from .writer import EncodedFrame, RecordingWriter, is_startable

__all__ = ["EncodedFrame", "Recording", "RecordingWriter", "is_startable"]
