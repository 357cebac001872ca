"""The frames that are measured with: the beginning of a shipped sequence."""

from ..sequences import captures, load_sequence
from .clip import Clip

SEQUENCE = "sim-LN"
SIZE_PX = (640, 360)
"""Width and height of the images."""
N_FRAMES = 16
"""How many are rendered, which takes half a second each."""


def filmed() -> Clip:
    """A walk over a lawn, with depth by stereo matching."""
    width_px, height_px = SIZE_PX
    planned = load_sequence(SEQUENCE, 0, {"rig.width_px": width_px, "rig.height_px": height_px})
    film = list(captures(planned, N_FRAMES))
    return Clip(
        intrinsics=film[0].intrinsics,
        grays=tuple(capture.gray_left for capture in film),
        depths_m=tuple(capture.depth_raw_m for capture in film),
    )
