"""How much of what moves survives a correction, and how much of it stays behind as a ghost."""

from voxdepth.metrics import Share, ghost_share, survival
from voxdepth.types import FloatImage

from .cell import AS_GIVEN, FILLED, Figure
from .groups import ALL
from .sources import Judged

MOVING, DEPARTED = "moving", "departed"
"""Masks: the pixels of things that move, and those that one left some frames ago."""


class MovingScore:
    """Shares of a method, and of the raw depth of the same frames, without which they say little."""

    def __init__(self) -> None:
        self._survival = {"survival": Share(), "survival_raw": Share()}
        self._ghosts = {"ghosts": Share(), "ghosts_raw": Share()}

    def add(self, judged: Judged, depth_m: FloatImage) -> None:
        """Take in a frame with its corrected depth [m], shape (H, W); nothing, if nothing is known to move in it."""
        if judged.moving is None or judged.departed_m is None:
            return
        for name, given_m in (("survival", depth_m), ("survival_raw", judged.frame.depth_m)):
            self._survival[name] += survival(given_m, judged.reference_m, judged.moving)
        for name, given_m in (("ghosts", depth_m), ("ghosts_raw", judged.frame.depth_m)):
            self._ghosts[name] += ghost_share(given_m, judged.reference_m, judged.departed_m)

    def figures(self) -> list[Figure]:
        """All shares; those of no pixel are left out."""
        shares = [(name, MOVING, AS_GIVEN, share) for name, share in self._survival.items()]
        shares += [(name, DEPARTED, FILLED, share) for name, share in self._ghosts.items()]
        return [
            Figure(metric=name, mask=mask, within=ALL, on=on, value=share.value, unit="share", n=share.of)
            for name, mask, on, share in shares
            if share.of
        ]
