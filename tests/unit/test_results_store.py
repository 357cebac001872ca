"""Results are kept in files that read back as they were, or are refused."""

from dataclasses import dataclass
from math import inf, isnan, nan
from pathlib import Path

import pytest

from voxdepth.tools.results.interval import Interval
from voxdepth.tools.results.store import Records


@dataclass(frozen=True, kw_only=True)
class Kept:
    name: str
    values: tuple[float, ...]
    found: Interval | None = None


KEPT = Records(Kept)


def test_a_result_reads_back_with_all_its_digits(tmp_path: Path) -> None:
    result = Kept(name="küche", values=(0.1 + 0.2, inf, -0.0), found=Interval(1 / 3, -inf, 2))
    KEPT.write(tmp_path / "there/a.json", result)
    assert KEPT.decode((tmp_path / "there/a.json").read_bytes()) == result
    assert isnan(KEPT.decode(KEPT.encode(Kept(name="", values=(nan,)))).values[0])


def test_a_file_of_another_version_is_refused_with_both_versions() -> None:
    newer = Records(Kept, version=3).encode(Kept(name="a", values=()))
    with pytest.raises(ValueError, match="its format is version 3, and this version of voxdepth reads 1"):
        KEPT.decode(newer)
    with pytest.raises(ValueError, match=r"its format is version 1, .* reads 3"):
        Records(Kept, version=3).decode(b'{"name": "a", "values": []}')


@dataclass(frozen=True, kw_only=True)
class Larger(Kept):
    setting: int = 2


def test_keys_that_the_type_lacks_are_refused_unless_they_may_be_dropped() -> None:
    larger = Records(Larger).encode(Larger(name="a", values=(1,)))
    with pytest.raises(ValueError, match="setting"):
        KEPT.decode(larger)
    assert Records(Kept, extra="ignore").decode(larger) == Kept(name="a", values=(1,))


@pytest.mark.parametrize(("found", "text"), [(Interval(7, 5.06, 8.8), "7.0 points [5.1, 8.8]"),
                                            (Interval(7, nan, nan), "7.0 points")])  # fmt: skip
def test_an_interval_is_written_behind_its_estimate_if_it_is_known(found: Interval, text: str) -> None:
    assert found.text(".1f", "points") == text
    assert (found.is_known, found.is_positive) == ("[" in text, "[" in text)
    assert found.scaled(2).value == 14
