"""Looking over the paper's corrector's shoulder: which windows were fused, and what that took."""

from collections.abc import Mapping

from voxdepth.corrector import VoxDepth
from voxdepth.paper.diagnostics import PaperDiagnostics, Phase
from voxdepth.paper.method import Aligned
from voxdepth.paper.template import Template
from voxdepth.types import CorrectedDepth, Frame


class Watched:
    """A `StagedCorrector` that does what another does, and notes every template that comes into force."""

    uses_gray = True

    def __init__(self, corrector: VoxDepth) -> None:
        self._corrector = corrector
        self._template: Template | None = None
        self.fusions_s: list[Mapping[str, float]] = []
        """Times of the steps of each fusion [s], in order."""

    def process(self, frame: Frame) -> CorrectedDepth:
        """See `DepthCorrector`."""
        return self.combine(self.align(frame))

    def reset(self) -> None:
        """See `DepthCorrector`."""
        self._corrector.reset()

    def close(self) -> None:
        """Wait until nothing is being fused any more."""
        self._corrector.close()

    def align(self, frame: Frame) -> Aligned:
        """See `StagedCorrector`."""
        aligned: Aligned = self._corrector.align(frame)
        if aligned.template is not None and aligned.template is not self._template:
            self._template = aligned.template
            self.fusions_s.append(aligned.template.timings_s)
        return aligned

    def combine(self, aligned: Aligned) -> CorrectedDepth:
        """See `StagedCorrector`."""
        return self._corrector.combine(aligned)


def is_correcting(corrected: CorrectedDepth) -> bool:
    """Whether the paper's method was in the correction state when it returned a frame."""
    diagnostics = corrected.diagnostics
    return isinstance(diagnostics, PaperDiagnostics) and diagnostics.phase is Phase.CORRECTING
