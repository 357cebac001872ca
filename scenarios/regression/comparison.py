"""What a corrector is compared with, a file or a commit, and what is left of the worst case."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from voxdepth.corrector_spec import CorrectorSpec

from ..errors import ScenarioError
from ..rerun.frames import record_case
from ..revision import commit_of
from .clips import Corrects, Here, at_revision, clips
from .judgement import Judgement, judge
from .measurement import Baseline, read
from .picture import draw, worst_frame

MEASURED = "as measured"
"""Title of the raw depth, which stands for the one before where a corrector of before is not at hand."""
PICTURE, RECORDING = "regress.png", "regress.rrd"


class Opponent(NamedTuple):
    """What a corrector is compared with."""

    title: str
    corrects: Corrects | None = None
    """A corrector to measure by turns with it."""
    file: Path | None = None
    """A file with figures."""

    def judge(self, now: Baseline, by_turns: Baseline | None) -> Judgement:
        """Judge the figures of a corrector, given those that were measured of the opponent, if they were."""
        before = by_turns
        if self.file is not None:
            before = read(self.file)
            before.require_same_clips(now, self.file)
        return judge(
            now.corrector, now.figures, None if before is None else before.figures, by_turns=by_turns is not None
        )


@contextmanager
def opponent(spec: str, against: str | None) -> Iterator[Opponent]:
    """Give the opponent of a corrector: a file, a commit of the checkout around the current folder, or none.

    Raises:
        ScenarioError: There is neither such a file nor such a commit, the file is damaged, or the commit does not hold
            the corrector.
    """
    if against is None:
        yield Opponent("")
    elif (path := Path(against)).is_file():
        read(path)  # Errors come before the work.
        yield Opponent(against, file=path)
    else:
        try:
            commit_of(Path.cwd(), against)
        except ScenarioError as error:
            raise ScenarioError(f"{against} is no file of --save, and as a commit: {error}") from error
        with at_revision(spec, against) as corrects:
            yield Opponent(against, corrects)


def write_worst(out: Path, judgement: Judgement, corrects: Corrects, other: Opponent) -> list[Path]:
    """Write a picture of the worst frame and a recording of its clip; return the files, or none if nothing is worse.

    Args:
        out: Folder of the files.
        judgement: What became worse.
        corrects: The corrector that was evaluated.
        other: What it was compared with; without a corrector of it, the picture shows the raw depth instead.
    """
    worst = judgement.worst
    if worst is None:
        return []
    (clip,) = clips([worst.case], [worst.seed])
    title = MEASURED if other.corrects is None else f"at {other.title}"
    before = (other.corrects or Here(CorrectorSpec.of("raw").create))(clip).results
    now = corrects(clip).results
    draw(out / PICTURE, worst_frame(clip, worst.figure, before, title, now))
    record_case(out / RECORDING, clip.title, zip(clip.frames, now, strict=True))
    return [out / PICTURE, out / RECORDING]
