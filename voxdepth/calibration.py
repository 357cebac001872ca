"""Confidence of the correctors that have none of their own: fitted probabilities that their fills are right.

`confidence.toml` has the share of right pixels of each corrector and source in real recordings, which `python -m
tests.calibrate --write FOLDER...` fits. Measured pixels keep 1: how far a sensor errs depends on the sensor, which
its user knows.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from .checksums import DamageError, digest_of
from .errors import ConfigError
from .pipeline import StagedCorrector
from .text import decoded, parsed_toml
from .types import CorrectedDepth, DepthCorrector, Frame, close

FILE = Path(__file__).with_name("confidence.toml")
SEAL = "# sha256 "
"""How the last line of the file begins, which has the digest of all before."""
Fills = Mapping[str, float]
"""Probability of being right of what a corrector fills, by its source: `memory` or `inpainted`; 0 without one."""


class Calibrated:
    """A corrector with fitted confidences, and everything else as it is.

    Args:
        bare: The corrector; its own confidence is replaced. If it has two stages, they stay two.
        fills: The probabilities.
    """

    def __init__(self, bare: DepthCorrector, fills: Fills) -> None:
        self.bare, self._fills = bare, fills
        self.uses_gray = bare.uses_gray
        self._table = np.zeros(256, np.float32)
        self._table[:4] = 0, 1, fills.get("memory", 0), fills.get("inpainted", 0)  # In the order of `Source`.
        if isinstance(bare, StagedCorrector):
            self.align, self.combine = bare.align, lambda aligned: self._calibrated(bare.combine(aligned))

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy the corrector as its bare one is copied."""
        return Calibrated, (self.bare, self._fills)

    def __copy__(self) -> "Calibrated":
        """Return a copy with a memory of its own."""
        return deepcopy(self)

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame."""
        return self._calibrated(self.bare.process(frame))

    def reset(self) -> None:
        """Forget the stream."""
        self.bare.reset()

    def close(self) -> None:
        """End the threads of the corrector, if it has some."""
        close(self.bare)

    def _calibrated(self, corrected: CorrectedDepth) -> CorrectedDepth:
        confidence: Any = cv2.LUT(corrected.source, self._table)
        return replace(corrected, confidence=confidence)


def calibrated(corrector: DepthCorrector, name: str) -> DepthCorrector:
    """Return the corrector with the confidence that is fitted to that name; itself if there is none."""
    fills = fitted().get(name)
    return corrector if fills is None else Calibrated(corrector, fills)


@cache
def fitted() -> Mapping[str, Fills]:
    """Return the probabilities by corrector; a damaged file is a `ConfigError`."""
    try:
        data = FILE.read_bytes()
        text, _, digest = decoded(data).rpartition(SEAL)
        if digest != f"{digest_of(text.encode())}\n":
            raise DamageError("it does not end with its digest")
        return parsed_toml(data)
    except (OSError, ValueError) as error:
        raise ConfigError(
            f"{FILE} is damaged ({error}): restore it with pip install --force-reinstall voxdepth"
        ) from error


def sealed(text: str) -> str:
    """Return the text of a file of probabilities with its digest at the end."""
    return f"{text}{SEAL}{digest_of(text.encode())}\n"
