"""The result of an evaluation in sentences, from the numbers of its tables."""

from collections import Counter
from collections.abc import Iterator

from ... import registry
from ..results.interval import Interval
from .frames import HOLES
from .shares import ALL_KINDS, PixelKind, Shares
from .suite import Evaluation

ALL_EVALUATED = 0.995
"""Share of evaluated pixels that is reported as all."""
LEAST_LEAD = 0.0005
"""A smaller difference of two shares is reported as none: it would be written as 0.0 points."""
NOTHING = "No method has a result that could be compared."


def verdict(evaluation: Evaluation) -> list[str]:
    """Say which methods failed, which one is best in how many recordings, and by how much in each of them."""
    compared = [shares for shares in evaluation.shares if shares.overall.ranked]
    sentences = map(_of_recording, compared) if compared else [NOTHING]
    return [*_failed(evaluation), *_of_recordings(compared), *sentences]


def _failed(evaluation: Evaluation) -> Iterator[str]:
    """Say which methods failed in how many sequences, if any: what follows is without them."""
    failed = Counter(result.method for result in evaluation.failures)
    attempted = Counter(result.method for result in evaluation.results)
    if failed:
        of = [f"{registry.title(method)} in {n} of {attempted[method]} sequences" for method, n in failed.items()]
        yield f"Failed: {', '.join(of)}. A method that failed in a recording is not compared over all of its pixels."


def _of_recordings(compared: list[Shares]) -> Iterator[str]:
    """Say in how many of several recordings a method is better than each other one, and in how many none is."""
    if len(compared) > 1:
        best = Counter(method for shares in compared if (method := _winner(shares.overall)))
        said = [f"{registry.title(method)} is the best in {n}" for method, n in best.most_common()]
        if unclear := len(compared) - best.total():
            said.append(f"no single method in {unclear}")
        yield f"Of {len(compared)} recordings, {_listed(said)}."


def _of_recording(shares: Shares) -> str:
    """Say which method fills most evaluated pixels right, where another one is ahead, and what was not evaluated."""
    sentences = [*_best(shares.overall), *_ahead(shares), *_own_holes(shares), *_evaluated(shares)]
    return f"{shares.recording}: {' '.join(sentences)}"


def _best(kind: PixelKind) -> Iterator[str]:
    """Say which method is the best, which ones do not differ from it, and its lead over the next one."""
    best, equals = kind.ranked[0], _equals(kind)
    yield f"{registry.title(best)} gives {100 * kind.share(best).value:.1f} % of the judged pixels a depth within 5 %."
    if equals:
        others = [f"{registry.title(other)} ({_points(kind.lead(best, other))})" for other in equals]
        yield f"There is no difference beyond chance between it and {_listed(others)}."
    if rest := [method for method in kind.ranked[1:] if method not in equals]:
        lead, which = kind.lead(best, rest[0]), "the next method" if equals else "the best other method"
        unknown = "" if lead.is_known else ", which may be chance: too few places were judged for an interval"
        yield f"It leads {which}, {registry.title(rest[0])}, by {_points(lead)}{unknown}."


def _ahead(shares: Shares) -> Iterator[str]:
    """Say of which kinds of pixels another method is ahead of the one that is the best of all."""
    best, ahead = shares.overall.ranked[0], []
    for kind in shares.kinds.values():
        leader = next(iter(kind.ranked), best)
        if leader != best and best in kind.draws and (lead := kind.lead(leader, best)).is_positive:
            ahead.append(f"{registry.title(leader)} in {kind.title} by {_points(lead)}")
    if ahead:
        yield f"Ahead of it: {_listed(ahead)}."


def _own_holes(shares: Shares) -> Iterator[str]:
    """Say how the best method fills the sensor's own holes, unless another one is ahead: other kinds were made."""
    best = shares.overall.ranked[0]
    for kind in shares.kinds.values():
        others = [method for method in kind.ranked if method != best]
        if kind.mask != HOLES or len(shares.kinds) == 1 or best not in kind.draws or not others:
            continue
        first, second = (best, others[0]) if kind.ranked[0] == best else (others[0], best)
        lead = kind.lead(first, second)
        if first == best or not lead.is_positive:
            than = f"{_points(lead)} {'more' if first == best else 'less'} than {registry.title(others[0])}"
            yield f"Of the sensor's own holes it gives {100 * kind.share(best).value:.1f} % such a depth, {than}."


def _evaluated(shares: Shares) -> Iterator[str]:
    """Say of which kinds not all pixels were evaluated: the others may be harder ones."""
    kinds = [kind for kind in shares.kinds.values() if kind.mask != ALL_KINDS and kind.evaluated_share < ALL_EVALUATED]
    of = [f"{100 * kind.evaluated_share:.0f} % of the {kind.title}" for kind in kinds]
    if of:
        yield f"Only {_listed(of)} were judged."


def _equals(kind: PixelKind) -> list[str]:
    """Return the methods whose difference from the best one may be none: its interval contains 0, or it is as small.

    Two settings of one corrector may differ in some pixels, always in the same sense.
    """
    best, *others = kind.ranked
    leads = {other: kind.lead(best, other) for other in others}
    return [o for o, lead in leads.items() if lead.is_known and (not lead.is_positive or lead.value < LEAST_LEAD)]


def _winner(kind: PixelKind) -> str | None:
    """Return the method that is certainly better than each other one; None if there is none."""
    best, *others = kind.ranked
    return best if all(kind.lead(best, other).is_positive for other in others) else None


def _points(lead: Interval) -> str:
    return lead.scaled(100).text(".1f", "points")


def _listed(words: list[str]) -> str:
    """Join words as in `a, b and c`."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)
