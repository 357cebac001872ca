"""The result of an evaluation in one sentence, from the numbers of its tables."""

from collections import Counter
from collections.abc import Sequence

import pandas as pd

from ... import registry
from .frames import HOLES
from .methods import is_baseline
from .quantities import OVER_BEST, WITHIN_5, numbers_of
from .suite import Evaluation

ALL_JUDGED = 0.995
"""Share of judged holes that is told as all."""


def verdict(evaluation: Evaluation) -> str:
    """Say which method fills most pixels right: of the sensor's own holes, where any sequence has a reference."""
    shares, leads = (100 * numbers_of(evaluation, quantity)[0] for quantity in (WITHIN_5, OVER_BEST))
    shares = shares[0].dropna()
    hidden = {name: evaluation.sequences[name].reference.hidden for name in shares.index.unique("sequence")}
    names = [name for name in hidden if hidden[name] == HOLES] or list(hidden)
    best = {name: shares[name].idxmax() for name in names}
    if not names:
        return "No method has a result that could be compared."
    if len(names) == 1:
        (name,) = names
        pixels = "the holes" if hidden[name] == HOLES else f"the held-out {hidden[name].replace('-', ' ')}"
        of = name.removesuffix(f"-{hidden[name]}")
        return f"Of {pixels} of {of}, {_won(shares[name], leads, name, best[name])}.{_judged(evaluation, names)}"
    method, wins = Counter(best.values()).most_common(1)[0]
    judged = _judged(evaluation, names)
    won = leads.reindex([(name, method) for name in names if best[name] == method]).dropna(subset=[0])
    pixels = "the holes" if hidden[names[0]] == HOLES else "the held-out pixels"
    text = f"{registry.title(method)} fills most of {pixels} within 5 % in {wins} of {len(names)} sequences"
    if won.empty:
        return f"{text}.{judged}"
    by_chance = f", which may be chance in {n}" if (n := int((~(won[1] > 0)).sum())) else ""
    return f"{text}, {won[0].min():.0f} to {won[0].max():.0f} points more than {_over(method)}{by_chance}.{judged}"


def _won(shares: pd.Series, leads: pd.DataFrame, name: str, method: str) -> str:
    """Say how much the best method fills right in a sequence, and its lead over the best other baseline if any."""
    text = f"{registry.title(method)} fills {shares[method]:.0f} % within 5 %"
    baselines = shares[[other for other in shares.index if other != method and is_baseline(other)]]
    if baselines.empty:
        return text
    lead, low, high = leads.loc[(name, method)]
    interval = f" [{low:.0f}, {high:.0f}]" if pd.notna(low) else ""
    by_chance = "" if low > 0 else ", which may be chance"
    rival = registry.title(baselines.idxmax())
    return f"{text}, {lead:.0f} points{interval} more than {_over(method)}, {rival}{by_chance}"


def _judged(evaluation: Evaluation, names: Sequence[str]) -> str:
    """Say how many of the sensor's holes have a reference, where not all have: the others may be harder ones."""
    infos = [info for name in names if (info := evaluation.sequences[name]).reference.hidden == HOLES]
    shares = sorted(info.judged_share for info in infos)
    if not shares or shares[0] > ALL_JUDGED:
        return ""
    span = f"{shares[0]:.0%}" if len(shares) == 1 else f"{shares[0]:.0%} to {shares[-1]:.0%}"
    by = " or ".join(dict.fromkeys(info.reference.name for info in infos)).capitalize()
    return f" {by} could judge {span.replace('%', ' %')} of the holes."


def _over(method: str) -> str:
    return f"the best {'other ' if is_baseline(method) else ''}baseline"
