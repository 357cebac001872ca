"""Files of scenarios, sequences, studies and correctors from strangers are read, or refused in one line."""

import tomllib
from collections.abc import Callable, Iterator
from contextlib import suppress
from copy import deepcopy
from datetime import UTC, date, datetime, time
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from scenarios.config import load_run
from scenarios.files import DATA
from scenarios.sequences import load_sequence
from scenarios.study.design import expand, load_study
from tests.fuzz.damage import damages
from tests.fuzz.fuzzing import fuzzed, in_time, require_clear
from voxdepth.errors import VoxDepthError
from voxdepth.registry import config_of
from voxdepth.tools.commands import _spec
from voxdepth.tools.files import to_toml

FEW_RUNS = 20
"""A study with more runs is not expanded."""


def studied(path: str) -> None:
    study = load_study(path)
    if study.seeds.count * len(study.scenarios) * sum(len(arm.levels) for arm in study.arms) <= FEW_RUNS:
        expand(study)


READERS: dict[str, Callable[[str], object]] = {
    "scenarios": lambda path: to_toml(load_run(path, None, {})),
    "sequences": lambda path: to_toml(load_sequence(path, None, {})),
    "studies": studied,
    "voxdepth": lambda path: _spec("voxdepth", Path(path)),
    "paper": lambda path: _spec("paper", Path(path)),
}
SHIPPED = {
    kind: [path.read_bytes() for path in sorted((DATA / kind).glob("*.toml"))]
    for kind in ("scenarios", "sequences", "studies")
} | {name: [to_toml(config_of(name)).encode()] for name in ("voxdepth", "paper")}  # type: ignore[arg-type]

KEYS = st.one_of(
    st.sampled_from(["kind", "name", "seed", "scenario", "config", "corrector", "method", "", "__class__", "a.b", "é"]),
    st.text(max_size=4),
)
LEAVES = st.one_of(
    st.sampled_from(
        [
            0, 1, -1, 2**31, 2**63 - 1, -(2**63), 2**64, 10**30, 10**400, 0.0, -0.0, 0.1, 1e-320, 1e308, -1e308, 1e9,
            float("nan"), float("inf"), -float("inf"), True, False, "", " ", "x" * 5_000, "../../x", "/etc/passwd",
            "city", "truth", "noisy", "stereo", "nan", "1", "[red]", "a\nb", "\0", "\N{BELL}", "漢字", "os:system",
            date(1, 1, 1), datetime.max, datetime(2000, 1, 1, tzinfo=UTC), time(23, 59), [], {}, [[]], [0], [1.0, 2.0],
        ]
    ),
    st.integers(), st.floats(), st.text(max_size=8), st.booleans(),
)  # fmt: skip
VALUES = st.recursive(
    LEAVES,
    lambda below: st.one_of(st.lists(below, max_size=4), st.dictionaries(KEYS, below, max_size=3)),
    max_leaves=6,
)


def tables(value: Any) -> Iterator[Any]:
    """All tables and arrays in a value, itself included."""
    if isinstance(value, dict | list):
        yield value
        for below in value.values() if isinstance(value, dict) else value:
            yield from tables(below)


def drop(table: Any, key: Any, draw: st.DrawFn) -> None:
    del table[key]


def replace(table: Any, key: Any, draw: st.DrawFn) -> None:
    table[key] = deepcopy(draw(VALUES))  # A later change must not alter the strategy's own lists.


def stretch(table: Any, key: Any, draw: st.DrawFn) -> None:
    factor = draw(st.sampled_from([-1, 0, 0.5, 2, 1000, 1e-6, 1e9, 1e300]))
    if isinstance(table[key], int | float) and not isinstance(table[key], bool):
        with suppress(OverflowError):  # Of numbers that are larger than any of floating point.
            table[key] = type(table[key])(table[key] * factor)


def change_type(table: Any, key: Any, draw: st.DrawFn) -> None:
    table[key] = draw(st.sampled_from([str, lambda x: [x], lambda x: {"kind": x}, lambda x: [x] * 50, bool]))(
        table[key]
    )


def rename(table: Any, key: Any, draw: st.DrawFn) -> None:
    if isinstance(table, dict):
        table[draw(KEYS)] = table.pop(key)


def double(table: Any, key: Any, draw: st.DrawFn) -> None:
    if isinstance(table, list):
        table.append(table[key])


def nest(table: Any, key: Any, draw: st.DrawFn) -> None:
    for _ in range(draw(st.sampled_from([1, 5, 60]))):
        table[key] = draw(st.sampled_from([lambda x: [x], lambda x: {"x": x}]))(table[key])


CHANGES = (drop, replace, replace, replace, stretch, stretch, change_type, rename, double, nest)


@st.composite
def changed(draw: st.DrawFn, shipped: bytes) -> bytes:
    """A file with a few values changed, or with damaged bytes, or with what a writer of TOML would never write."""
    content = tomllib.loads(shipped.decode())
    for _ in range(draw(st.integers(0, 3))):
        table = draw(st.sampled_from([table for table in tables(content) if table] or [{"x": 1}]))
        key = draw(st.sampled_from(sorted(table))) if isinstance(table, dict) else draw(st.integers(0, len(table) - 1))
        draw(st.sampled_from(CHANGES))(table, key, draw)
    data = written(content) or shipped
    for _ in range(draw(st.sampled_from([0, 0, 0, 1, 2]))):
        data = draw(damages)(data)
    if draw(st.integers(0, 9)) == 0:
        deep = draw(st.sampled_from([10, 500, 5_000]))
        data += draw(
            st.sampled_from([b"x=" + b"[" * deep, b"x=" + b"9" * deep, b"[" + b"a." * deep + b"a]", b"\xef\xbb\xbf"])
        )
    return data


def written(content: dict[str, Any]) -> bytes | None:
    try:
        return tomli_w.dumps(content).encode()
    except (TypeError, ValueError, RecursionError):  # Not everything can be written.
        return None


@st.composite
def files(draw: st.DrawFn) -> tuple[str, bytes]:
    kind = draw(st.sampled_from(sorted(SHIPPED)))
    return kind, draw(changed(draw(st.sampled_from(SHIPPED[kind]))))


@pytest.mark.slow
@fuzzed(1500)
@given(file=files())
def test_a_file_is_read_or_refused_in_one_line(
    tmp_path_factory: pytest.TempPathFactory, file: tuple[str, bytes]
) -> None:
    kind, data = file
    path = tmp_path_factory.getbasetemp() / "file.toml"
    path.write_bytes(data)
    with in_time():
        try:
            READERS[kind](str(path))
        except VoxDepthError as error:
            require_clear(error)
