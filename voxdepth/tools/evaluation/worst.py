"""Where the best method of a recording fails: the frame in which it gives the fewest judged pixels a close depth."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ... import registry
from ...types import FloatArray
from .record import MethodResult, SequenceInfo
from .shares import PixelKind, Shares
from .suite import Evaluation

LEAST_JUDGED = 0.1
"""A frame with a smaller share of the judged pixels of the mean frame and kind of a recording is not its worst one: of
a few pixels, all may be wrong."""
AROUND = 3
"""Number of frames before and after the worst one that are shown with it."""


@dataclass(frozen=True, kw_only=True)
class Worst:
    """The worst frame of a recording, among those of all kinds of its pixels."""

    info: SequenceInfo
    """The kind of pixels of the recording that are judged in it."""
    kind: PixelKind
    """The shares of the same pixels in all frames."""
    frame: int
    """Its index among the frames that were evaluated."""
    compared: tuple[str, ...]
    """The method that is the best in the recording, and the best other one if there is one."""
    shares: dict[str, FloatArray]
    """Share of the judged pixels that each method gives a close depth, by frame; NaN where none is judged."""

    @property
    def shown(self) -> range:
        """The frames that a recording of it shows."""
        return range(max(0, self.frame - AROUND), min(self.info.frames, self.frame + AROUND + 1))

    def sentence(self, first: int) -> str:
        """Say how bad the frame is, by its number where the evaluation began with another one than 0."""
        best, *others = self.compared
        at, in_all = self.shares[best][self.frame], self.kind.share(best).value
        beside = "".join(
            f", and {registry.title(other)} {100 * self.shares[other][self.frame]:.1f} %" for other in others
        )
        return (
            f"{self.info.recording}: {registry.title(best)} is worst in frame {first + self.frame}: it gives "
            f"{100 * at:.1f} % of the judged pixels of the {self.kind.title} a depth within 5 % ({100 * in_all:.1f} % "
            f"in all frames){beside}."
        )


def worst_frames(evaluation: Evaluation) -> list[Worst]:
    """Return the worst frame of each recording in which methods could be compared."""
    return [_worst(evaluation, shares) for shares in evaluation.shares if shares.overall.ranked]


def _worst(evaluation: Evaluation, shares: Shares) -> Worst:
    best = shares.overall.ranked[0]
    of_best = [each for each in _judged(evaluation, shares.recording) if each.method == best]
    counts = {result.sequence: (_by_frame(result.close), _by_frame(result.judged)) for result in of_best}
    least = max(1.0, LEAST_JUDGED * float(np.mean(np.concatenate([judged for _, judged in counts.values()]))))
    *_, sequence, frame = min(
        (close[k] / judged[k], -judged[k], sequence, k)
        for sequence, (close, judged) in counts.items()
        for k in np.flatnonzero(judged >= least).tolist()
    )
    other = shares.overall.best_other(best)
    return Worst(
        info=evaluation.sequences[sequence],
        kind=shares.kinds[sequence],
        frame=frame,
        compared=(best,) if other is None else (best, other),
        shares={
            each.method: _shares(each) for each in _judged(evaluation, shares.recording) if each.sequence == sequence
        },
    )


def _judged(evaluation: Evaluation, recording: str) -> Iterator[MethodResult]:
    """Yield the results of a recording, but those of methods that failed."""
    for result in evaluation.results:
        if result.judged and evaluation.sequences[result.sequence].recording == recording:
            yield result


def _shares(result: MethodResult) -> FloatArray:
    close, judged = _by_frame(result.close), _by_frame(result.judged)
    shares: FloatArray = np.divide(close, judged, out=np.full(len(judged), np.nan), where=judged > 0)
    return shares


def _by_frame(counts: tuple[tuple[int, ...], ...]) -> FloatArray:
    """Return the number of pixels of each frame, given those of its tiles, shape (frames,)."""
    pixels: FloatArray = np.array(counts, np.float64).sum(axis=1)
    return pixels
