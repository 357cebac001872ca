"""Correctors whose results tell what they were given."""

import time

import numpy as np

from voxdepth.types import CorrectedDepth, DepthCorrector, Frame, Intrinsics

SLOW_S = 0.12
"""Time that the slow one takes for a frame [s]."""


class Echo(DepthCorrector):
    """Adds a millimetre for each gray level to the depth, so that both images of a pair are seen in the result."""

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s

    def process(self, frame: Frame) -> CorrectedDepth:
        time.sleep(self._delay_s)
        depth_m = np.where(frame.depth_m > 0, frame.depth_m + frame.gray.astype(np.float32) / 1000, 0)
        return CorrectedDepth.of(frame, depth_m.astype(np.float32))


def echo(intrinsics: Intrinsics) -> DepthCorrector:
    return Echo(0.0)


def slow(intrinsics: Intrinsics) -> DepthCorrector:
    return Echo(SLOW_S)


def failing(intrinsics: Intrinsics) -> DepthCorrector:
    class Failing(DepthCorrector):
        def process(self, frame: Frame) -> CorrectedDepth:
            raise ZeroDivisionError("a defect of the corrector")

    return Failing()
