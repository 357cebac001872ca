"""Figures that users would call better or worse: none is worse than its file says, and a worse one needs a reason."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from tests import gate
from tests.gate import Figure, depth_figures, flight_figures, judge, lines, read, recording_figure
from voxdepth.errors import ConfigError

PARTS: dict[str, Callable[[], Iterable[Figure]]] = {
    **{f"depth in {name}": partial(depth_figures, name) for name in gate.SEQUENCES},
    **{f"flight in {name}": partial(flight_figures, name) for name in gate.SCENARIOS},
    **{f"recording of {name}": lambda name=name: [recording_figure(name)] for name in gate.RECORDED_SCENARIOS},
}
LENGTH = Figure(name="length", value=2.0, unit="m", better="smaller", tolerance=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_no_figure_is_worse_than_the_file_says(part: str) -> None:
    before = {name: figure for name, figure in read().items() if name.startswith(f"{part}:")}
    measured = list(PARTS[part]())
    assert {one.name for one in measured} == set(before), "write the file with: python -m tests.gate --update"
    found = judge(measured, before)
    assert not found["worse"], "\n".join(lines(found, before))


def test_the_file_is_small_and_says_what_each_figure_means() -> None:
    assert len(read()) <= 200
    assert {name.partition(":")[0] for name in read()} == set(PARTS)
    for figure in read().values():
        assert figure.unit
        assert figure.better in ("larger", "smaller")
        assert figure.tolerance >= 0


@pytest.mark.parametrize(
    ("value", "better", "change"),
    [(2.05, "smaller", "same"), (2.2, "smaller", "worse"), (1.8, "smaller", "better"), (1.8, "larger", "worse")],
)
def test_a_change_has_a_direction_beyond_the_tolerance(value: float, better: str, change: str) -> None:
    before = replace(LENGTH, better=better)
    found = judge([replace(before, value=value)], {"length": before})
    assert [one for one in found if found[one]] == [change]
    said = list(lines(found, {"length": before}))
    assert said == ([] if change == "same" else [f"{change}: length: 2 became {value:g} m (tolerance 0.1)"])


def test_a_worse_figure_is_written_with_a_reason_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(gate, "GATE", tmp_path / "gate.toml")
    measured = [LENGTH]
    monkeypatch.setattr(gate, "figures", lambda: measured)
    assert gate.main(["--update"]) == 0
    measured[0] = replace(LENGTH, value=3.0)
    assert gate.main([]) == 1
    assert gate.main(["--update"]) == 1
    assert "say why with --because" in capsys.readouterr().err
    assert read(gate.GATE)["length"].value == 2.0
    assert gate.main(["--update", "--because", "a longer way is safer"]) == 0
    assert read(gate.GATE)["length"] == replace(LENGTH, value=3.0, because="a longer way is safer")
    assert gate.main([]) == 0
    measured[0] = replace(LENGTH, value=3.05)
    assert gate.main(["--update"]) == 0
    assert read(gate.GATE)["length"] == replace(LENGTH, value=3.0, because="a longer way is safer"), "it is the same"
    measured[0] = replace(LENGTH, value=1.0)
    assert gate.main(["--update"]) == 0
    assert read(gate.GATE)["length"] == replace(LENGTH, value=1.0)


def test_a_figure_that_is_gone_or_new_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not measured: width; write it with --update"):
        judge([LENGTH], {"length": LENGTH, "width": replace(LENGTH, name="width")})
    assert list(lines(judge([LENGTH], {}), {})) == ["new: length: 2 m"]
