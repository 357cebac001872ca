"""Command lines with any values end with a code that means something, and never with a traceback."""

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from enum import Enum
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from scenarios import batch
from scenarios.files import DATA, shipped_names
from scenarios.study.executors import Serial
from scenarios.study.run import run_study
from sim.world import World
from tests.fuzz.commands import APP, FlightError, require_clean_end
from tests.fuzz.fuzzing import fuzzed, in_time
from tests.fuzz.test_datasets import bag, write_recording, write_tum
from tests.studies import arm, fake, study, unseen
from voxdepth.registry import CORRECTOR_NAMES
from voxdepth.tools import doctor
from voxdepth.tools.benchmark import suite

WORDS = (
    "", " ", "-", "--", "x", "é漢", "[bold]x[/nothing]", "a\nb", "x" * 300, "../../..", "~", "*", "%s", "{}",
    "all", "raw,voxdepth", "voxdepth[fill=all]", "voxdepth[", "os:system", "json:loads",
    "0x0", "1x1", "96x64", "99999x99999",
    "160x", "²x²", "nan,inf", "0.5,0.5", "quality", "rq1", "sim-LN", "reference", "local",
    "tcp://127.0.0.1:1", "true-pose",
)  # fmt: skip
NUMBERS = (
    "0", "1", "2", "-1", "1e3", "nan", "inf", "-inf", "1e308", "1e-320", "0.5", "1_0", "٣", "0x10", "", "4294967296",
    "4294967295", "9223372036854775808", "9" * 400, "-0.0", "1,0", "true",
)  # fmt: skip
PATHS = (
    "recording", "tum", "bag/walk.bag", "study", "city.toml", "empty.toml", "missing", "missing.toml", "new/deep/out",
    "out.png", "out.jpg", "out.gif", "out.mcap", "out.rrd", "run.rrd", "city.toml/x", "loop", ".", "..", "/dev/null",
    "/dev/full", "/proc/self/fd", "/dev/null/x.png", "a" * 300, "é漢.png", "", "-", "tum/rgb.txt", "folder.toml",
)  # fmt: skip


def leaves(command: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """All commands with the words that call them."""
    if hasattr(command, "commands"):
        for name, below in command.commands.items():
            yield from leaves(below, (*path, name))
    else:
        yield path, command


COMMANDS = dict(leaves(typer.main.get_command(APP)))


GOOD = {
    "scenario": ("city", "city.toml", "forest"), "scenarios": ("gap",), "sequence": ("sim-LN",),
    "names": ("quality", "rq1", "artefacts"), "folder": ("recording", "tum", "bag/walk.bag"), "data": ("recording",),
    "recording": ("recording",), "path": ("run.rrd",), "file": ("smoke", "pilot"),
    "key": ("0", "a", ""), "size": ("96x64",), "sequences": ("sim-LN",),
    "corrector": CORRECTOR_NAMES, "methods": ("raw,voxdepth", "median"), "depth_topic": ("/depth",), "arm": ("a", "b"),
    "gray_topic": ("/gray",), "config": ("empty.toml",), "json": ("new.json",), "rates": ("0.5,0.6",), "to": ("new",),
    "golden": ("new",), "cluster": ("tcp://127.0.0.1:1",), "frames": ("1", "2", "3"), "drone": ("0",),
}  # fmt: skip
"""What a user may mean by a parameter; others are numbers or files to write."""
OUTPUTS = ("new", "out.png", "out.jpg", "out.gif", "out.mcap", "out.rrd", "new/deep")


def kind_of(parameter: Any) -> Any:
    """The type of a parameter, or of the items of a list."""
    kind = parameter.type_descriptor.annotation
    return kind if get_origin(kind) is Literal else next(iter(get_args(kind)), kind)


def choices_of(kind: Any) -> Sequence[str]:
    """The words that a type consists of; none if it has others."""
    if get_origin(kind) is Literal:
        return get_args(kind)
    return [choice.value for choice in kind] if isinstance(kind, type) and issubclass(kind, Enum) else []


def good_values(parameter: Any, of_study: bool) -> st.SearchStrategy[str]:
    kind = kind_of(parameter)
    if choices_of(kind):
        return st.sampled_from(choices_of(kind))
    usual = ("1", "2", "6") if kind in (int, float) else ("study",) if of_study else OUTPUTS
    return st.sampled_from(GOOD.get(parameter.name, usual))


def odd_values(parameter: Any) -> st.SearchStrategy[str]:
    """Values that may be of its type, or of any."""
    own = NUMBERS if kind_of(parameter) in (int, float) else PATHS if kind_of(parameter) is Path else WORDS
    names = (*shipped_names("scenarios"), *shipped_names("sequences"), *shipped_names("studies"), *CORRECTOR_NAMES)
    any_text = st.text(max_size=6).filter(lambda text: "\0" not in text and not text.startswith("/"))
    return st.one_of(st.sampled_from(own), st.sampled_from([*WORDS, *NUMBERS, *PATHS, *names]), any_text)


@st.composite
def lines(draw: st.DrawFn) -> list[str]:
    """A command with some of its options and arguments, of which a few are odd, and perhaps an unknown word."""
    path = draw(st.sampled_from(sorted(COMMANDS)))
    words = list(path)
    for parameter in COMMANDS[path].params:
        is_given = parameter.required or draw(st.integers(0, 9)) < 3
        if parameter.name == "help" or not is_given:
            continue
        option = []
        if parameter.param_type_name != "argument":
            option = [draw(st.sampled_from([*parameter.opts, *parameter.secondary_opts]))]
        if getattr(parameter, "is_flag", False):
            words += option
        else:
            is_odd = draw(st.integers(0, 3)) == 0
            words += [*option, draw(odd_values(parameter) if is_odd else good_values(parameter, path[0] == "study"))]
    if draw(st.integers(0, 29)) == 0:
        words.insert(draw(st.integers(0, len(words))), draw(st.sampled_from([*WORDS, "--help", "--version", "-x"])))
    elif draw(st.integers(0, 29)) == 0:
        words.pop()
    return words


def never(*_: Any, **__: Any) -> None:
    raise FlightError


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of what a user may have."""
    folder = tmp_path_factory.mktemp("whole")
    write_recording(folder / "recording")
    write_tum(folder / "tum")
    bag("walk.bag")(folder / "bag")
    run_study(study(arm("a"), arm("b")), folder / "study", Serial(fake), unseen)
    (folder / "city.toml").write_bytes((DATA / "scenarios" / "city.toml").read_bytes())
    (folder / "empty.toml").touch()
    (folder / "folder.toml").mkdir()
    (folder / "run.rrd").write_bytes(b"RRF2")
    (folder / "loop").symlink_to("loop")
    return folder


@pytest.fixture(scope="module", autouse=True)
def _nothing_flies_or_measures() -> Iterator[None]:
    """Stop commands where they would simulate, measure for long, start processes or a viewer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(World, "__init__", never)
        patch.setattr(batch, "ProcessPoolExecutor", never)
        patch.setattr("scenarios.study.run.run_study", never)
        patch.setattr("scenarios.study.diagnose.in_processes", never)
        patch.setattr("scenarios.free_space.in_processes", never)
        patch.setattr("scenarios.evaluation.suite.evaluate", never)
        patch.setattr("scenarios.experiments.runner.run", never)
        patch.setattr("scenarios.regression.measure", never)
        patch.setattr("scenarios.sensor_pictures.make_gallery", never)
        patch.setattr("scenarios.study.report.write_report", never)
        patch.setattr("scenarios.study.power.compare_arms", never)
        patch.setattr("scenarios.doctor.examine", tuple)
        patch.setattr(suite, "measure_quickly", never)
        patch.setattr("voxdepth.tools.benchmark.frames.walk", never)
        patch.setattr(doctor, "examine", tuple)
        patch.setattr(subprocess, "Popen", never)
        yield


def test_all_commands_are_known() -> None:
    assert {("run",), ("study", "report"), ("correct",)} < COMMANDS.keys()


@pytest.mark.slow
@pytest.mark.usefixtures("compiled")
@fuzzed(400)
@given(line=lines())
def test_a_command_line_ends_without_a_traceback(
    whole: Path, tmp_path_factory: pytest.TempPathFactory, line: list[str]
) -> None:
    folder = tmp_path_factory.getbasetemp() / "here" / "below" / "below"
    with in_time(), pytest.MonkeyPatch.context() as patch:
        shutil.rmtree(folder.parents[1], ignore_errors=True)
        shutil.copytree(whole, folder, symlinks=True)
        patch.chdir(folder)
        patch.setenv("HOME", str(folder))
        require_clean_end(line)
