"""Confidence of the correctors that have none of their own: fitted probabilities that their fills are right.

`confidence.toml` has the share of right pixels of each corrector and source, which `voxdepth experiment confidence`
fits to rendered sequences. Measured pixels keep 1: how far a sensor errs depends on the sensor, which its user knows.
"""

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
from pydantic import Field

from .errors import ConfigError
from .model import Model, explained
from .pipeline import StagedCorrector
from .types import CorrectedDepth, DepthCorrector, FloatImage, Frame, Source

FILE = Path(__file__).with_name("confidence.toml")
Probability = Annotated[float, Field(ge=0, le=1)]


class Fills(Model):
    """Probability of being right of what a corrector fills, by its source."""

    memory: Probability = 0.0
    inpainted: Probability = 0.0

    @property
    def by_source(self) -> FloatImage:
        """The probability of every `Source`, shape (4,)."""
        of_source = {Source.SENSOR: 1.0, Source.MEMORY: self.memory, Source.INPAINTED: self.inpainted}
        return np.array([of_source.get(source, 0.0) for source in Source], np.float32)


class Content(Model):
    """The content of a file."""

    correctors: dict[str, Fills]


class Calibrated:
    """A corrector with fitted confidences, and everything else as it is.

    Args:
        bare: The corrector; its own confidence is replaced.
        fills: The probabilities.
    """

    def __init__(self, bare: DepthCorrector, fills: Fills) -> None:
        self.bare = bare
        self.uses_gray = bare.uses_gray
        self._by_source = np.zeros(256, np.float32)
        self._by_source[: len(Source)] = fills.by_source

    def process(self, frame: Frame) -> CorrectedDepth:
        """Correct one frame."""
        return self._calibrated(self.bare.process(frame))

    def reset(self) -> None:
        """Forget the stream."""
        self.bare.reset()

    def close(self) -> None:
        """End the threads of the corrector, if it has some."""
        if (close := getattr(self.bare, "close", None)) is not None:
            close()

    def _calibrated(self, corrected: CorrectedDepth) -> CorrectedDepth:
        confidence: Any = cv2.LUT(corrected.source, self._by_source)
        return replace(corrected, confidence=confidence)


class CalibratedStages(Calibrated):
    """A corrector in two stages with fitted confidences. The stages may still overlap."""

    bare: StagedCorrector

    def align(self, frame: Frame) -> Any:
        """Do everything that depends on earlier frames."""
        return self.bare.align(frame)

    def combine(self, aligned: Any) -> CorrectedDepth:
        """Do the rest."""
        return self._calibrated(self.bare.combine(aligned))


def calibrated(corrector: DepthCorrector, name: str) -> DepthCorrector:
    """The corrector with the confidence that is fitted to that name; itself if there is none."""
    fills = read(FILE).get(name)
    if fills is None:
        return corrector
    return (
        CalibratedStages(corrector, fills) if isinstance(corrector, StagedCorrector) else Calibrated(corrector, fills)
    )


@cache
def read(file: Path) -> Mapping[str, Fills]:
    """The probabilities of a file by corrector.

    Raises:
        ConfigError: The file cannot be read, or holds something else.
    """

    def unreadable(reason: object) -> ConfigError:
        return ConfigError(
            f"cannot read the confidences {file}: {reason}; make them again with `voxdepth experiment confidence`"
        )

    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise unreadable(error) from error
    with explained(Content, unreadable, field="correctors"):
        return Content(correctors=content).correctors
