"""Regression tests of correctors on synthetic noise: did a change make one worse, in what, and where.

`clips` gives the sequences, one noise term at a time; `figures` what is measured of them; `judgement` the rule and the
limits; `measurement` the baseline of a file; and `picture` the worst frame.
"""

from collections.abc import Collection
from pathlib import Path

from voxdepth.corrector_spec import CorrectorFactory

__all__ = ["assert_no_worse"]


def assert_no_worse(make: CorrectorFactory, baseline: str | Path, cases: Collection[str] = ()) -> None:
    """Fail if a corrector is worse than the baseline of a file, or breaks a limit: for your own tests.

    Args:
        make: Makes the corrector for a camera, as `MyCorrector` or `TemporalCorrector` does.
        baseline: File that `voxdepth regress --save` wrote.
        cases: Cases to compare, as `flicker/high`; a case takes a second. Default: all.

    Raises:
        AssertionError: It is worse; the message says in what.
    """
    from .clips import Here
    from .judgement import judge
    from .measurement import measured, read

    before = read(Path(baseline))
    now, _ = measured(before.corrector, Here(make), cases=cases)
    before.require_same_clips(now, Path(baseline))
    judgement = judge(now.corrector, now.figures, before.figures)
    if judgement.is_bad:
        raise AssertionError("\n".join(judgement.verdict))
