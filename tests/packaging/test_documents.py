"""The documents: pictures and links exist, named files exist, commands accept their options, and examples run."""

import ast
import inspect
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import gymnasium
import numpy as np
import pytest
import typer

from voxdepth.tools.picture import NAMES
from voxdepth.types import Source

ROOT = Path(__file__).parents[2]
TUTORIALS = sorted((ROOT / "docs/tutorials").glob("*.md"))
TRAINING = ROOT / "docs" / "tutorials" / "train_a_follower.md"
"""Its example needs PyTorch, and minutes."""
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")), *TUTORIALS)
PAGES = (*DOCUMENTS, ROOT / "CHANGELOG.md", ROOT / "ros2/voxdepth_ros/README.md")
LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
PATH = re.compile(r"(?<![\w:/-])(?:voxdepth|sim|swarm|scenarios|tests|examples)/[\w./-]*\w(?:\.\w+)?")
CODE = re.compile(r"```sh\n(.*?)```|`([^`\n]+)`|^    (\S[^\n]*)$", re.DOTALL | re.MULTILINE)

MADE_OF = re.compile(r"^::: ([\w.]+)$", re.MULTILINE)
"""What the build puts into the page of the Python interface."""

named = pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)


def blocks(document: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", document.read_text(), re.DOTALL | re.MULTILINE)


def last_line(code: str) -> str:
    """What a program prints last."""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


def anchors(document: Path) -> set[str]:
    headings = re.findall(r"^#+ (.+)$", document.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def commands(document: Path) -> Iterator[list[str]]:
    """Words of every use of the command line, without comments."""
    for found in CODE.finditer(document.read_text()):
        for line in next(text for text in found.groups() if text is not None).splitlines():
            if line.strip().startswith("voxdepth "):
                yield shlex.split(line.split("#")[0].split(";")[0])


@named
def test_links_and_pictures_exist(document: Path) -> None:
    for link in LINK.findall(document.read_text()):
        if "://" in link:
            continue
        path, _, anchor = link.partition("#")
        target = (document.parent / path).resolve() if path else document
        assert target.exists(), link
        if anchor:
            assert anchor in anchors(target), link
        if target.suffix in (".gif", ".jpg", ".png"):
            assert target.stat().st_size < 500_000, link


def test_documents_and_legends_call_the_sources_of_depth_by_their_names_in_the_code() -> None:
    codes = ", ".join(f"{int(source)} {source.name.lower()}" for source in Source)
    assert f"mono8: {codes} |" in (ROOT / "docs/cameras.md").read_text()
    shown = [source.name.lower() for source in Source if source != Source.INVALID]
    assert [name.partition(": ")[2] for name in NAMES.values()] == shown


@named
def test_files_that_are_named_exist(document: Path) -> None:
    for path in PATH.findall(LINK.sub("", document.read_text())):
        assert "NAME" in path or (ROOT / path).exists(), path


@named
def test_names_of_the_code_that_are_named_exist(document: Path) -> None:
    for path, names in re.findall(r"`([\w/]+\.py)::([\w.]+)`", document.read_text()):
        scope = ast.parse((ROOT / path).read_text())
        for name in names.split("."):
            scope = next(node for node in ast.walk(scope) if getattr(node, "name", None) == name)


@named
def test_commands_accept_their_options(document: Path) -> None:
    from voxdepth.tools.cli import create_app

    for words in commands(document):
        command: Any = typer.main.get_command(create_app())
        for word in words[1:]:
            below = getattr(command, "commands", {})
            if word.startswith("--"):
                command = below.get("run", command)  # `study FILE` is short for `study run FILE`
                options = {name for option in command.params for name in (*option.opts, *option.secondary_opts)}
                assert word in options or word == "--help", words
            elif word in below:
                command = below[word]
            else:
                assert words[1] == "study" or not below, words


LINE = 120
"""Columns of a line, as in the code."""


def prose(document: Path) -> list[str]:
    """The lines of a document that people write, without tables."""
    text = re.sub(r"<!-- result .*?<!-- end -->", "", document.read_text(), flags=re.DOTALL)
    return [line for line in text.splitlines() if not line.lstrip().startswith("|")]


@pytest.mark.parametrize("document", PAGES, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_lines_are_no_longer_than_those_of_the_code(document: Path) -> None:
    long = [line for line in prose(document) if len(line) > LINE]
    assert not long, f"wrap these lines of {document.name} after {LINE} columns:\n" + "\n".join(long)


def test_the_readme_is_short() -> None:
    assert len(" ".join(prose(ROOT / "README.md")).split()) <= 900


def test_there_are_no_gaps() -> None:
    for document in DOCUMENTS:
        assert not re.search(r"^[A-Z]{4,}$|@@", document.read_text(), re.MULTILINE), document


def test_python_examples_are_valid() -> None:
    for document in DOCUMENTS:
        for example in blocks(document, "python"):
            ast.parse(example)


@pytest.mark.parametrize(("name", "word"), [("README.md", "from_millimetres"), ("docs/paper.md", "VoxDepth")])
def test_the_examples_of_the_library_run(name: str, word: str) -> None:
    (example,) = [block for block in blocks(ROOT / name, "python") if word in block]
    names: dict = {}
    exec(example, names)
    if "corrected" in names:
        assert names["corrected"].depth_m.shape == names["gray"].shape


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", [path for path in TUTORIALS if path != TRAINING], ids=lambda path: path.stem)
def test_the_examples_of_tutorials_run_one_after_the_other(tutorial: Path) -> None:
    program = "\n".join(blocks(tutorial, "python"))  # In a process of its own, as a reader has it.
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_examples_of_depth_noise_run_one_after_the_other() -> None:
    names: dict = {}
    for example in blocks(ROOT / "docs" / "depth_noise.md", "python"):
        exec(example, names)
    assert names["corrected"].depth_m.shape == names["shape"]


def test_the_program_of_the_steps_makes_what_the_method_makes() -> None:
    from voxdepth import TemporalCorrector

    names: dict = {}
    for example in blocks(ROOT / "docs" / "steps.md", "python"):
        exec(example, names)
    dataset, whole = names["dataset"], TemporalCorrector(names["dataset"].intrinsics)
    first, *_, last = [whole.process(dataset[index]) for index in range(8)]
    for name, image in names["shown"]._asdict().items():
        np.testing.assert_array_equal(image, getattr(last, name))
    is_measured = dataset[0].depth_m > 0
    assert (names["corrected"].depth_m[is_measured] == first.depth_m[is_measured]).mean() > 0.9
    assert (names["corrected"].depth_m[~is_measured] != first.depth_m[~is_measured]).mean() > 0.5


def test_the_example_of_a_regression_test_passes() -> None:
    (example,) = [block for block in blocks(ROOT / "docs" / "evaluation.md", "python") if "noisy_sequence" in block]
    names: dict = {}
    exec(example, names)
    names["test_flicker_is_removed"]()


def test_the_examples_of_configurations_are_accepted() -> None:
    from voxdepth.registry import resolve_config

    default, paper = blocks(ROOT / "docs" / "cameras.md", "toml")
    assert resolve_config("temporal", tomllib.loads(default)).fill == "none"
    assert resolve_config("voxdepth", tomllib.loads(paper)).dilation_px == 7


def test_the_example_of_a_sequence_can_be_loaded(tmp_path: Path) -> None:
    from scenarios.sequences import load_sequence

    (text,) = blocks(ROOT / "docs" / "sequences.md", "toml")
    (tmp_path / "mine.toml").write_text(text)
    planned = load_sequence(str(tmp_path / "mine.toml"), 0, {})
    assert planned.sequence.rig.noise.flicker.dropout == 0.05


def test_the_example_of_a_listed_world_is_flown(tmp_path: Path) -> None:
    from scenarios.config import images_of, load_run
    from scenarios.flight import fly
    from swarm.types import Outcome

    _, text = blocks(ROOT / "docs" / "scenes.md", "toml")
    route = "[[mission.routes]]\nstart_m = [0.0, 0.0, 3.0]\ngoal_m = [4.0, 0.0, 3.0]\n"
    (tmp_path / "mine.toml").write_text(f'name = "mine"\ndescription = "a world"\n{text}\n{route}')
    quick = {"mission.drones": 1, "rig.depth": "truth", "corrector": "raw", **images_of(64, 48)}
    run = load_run(str(tmp_path / "mine.toml"), 0, quick)
    scene = run.scenario.scene.build(0)
    assert [body.name.partition("-")[0] for body in scene.bodies] == ["ground", "wall", "mast"]
    assert [mover.body.name for mover in scene.movers] == ["balloon"]
    assert fly(run).result.outcome is Outcome.SUCCESS


def test_the_example_of_a_study_can_be_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from scenarios.study.design import GAIN, Axis, PrimaryComparison, expand, load_study

    study, axis, arms = blocks(ROOT / "docs" / "running_studies.md", "toml")
    along = tomllib.loads(axis)
    assert Axis.model_validate(along["axis"]).reference == "truth"
    assert PrimaryComparison.model_validate(along["declared"]).endpoint == GAIN
    (tmp_path / "mine.toml").write_text(study + arms)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "my_avoidance.py").write_text("from examples.straight_controller import create\n")
    (tmp_path / "my_corrector.py").write_text("class Mine:\n    latency_s = 0.01\n")
    loaded = load_study(str(tmp_path / "mine.toml"))
    assert len(loaded.arms) == 5
    controllers = {spec.arm: spec.run.scenario.mission.controller for spec in expand(loaded)}
    assert controllers["my controller"] == "my_avoidance:create"


@pytest.mark.slow
def test_the_example_of_an_environment_steps() -> None:
    example, swarm = blocks(ROOT / "docs" / "environments.md", "python")
    compile(swarm, "environments.md", "exec")  # It flies in test_environment_pettingzoo.py.
    assert last_line(example + "print(picture.shape[2], observation['nearness'].shape)") == "3 (1, 60, 80)"


def test_the_recipe_of_the_tutorial_makes_its_environment() -> None:
    (recipe,) = blocks(TRAINING, "python")
    names: dict = {}
    exec(next(line for line in recipe.splitlines() if line.startswith("options = ")), names)
    (task,) = re.findall(r'make_vec_env\("([^"]+)"', recipe)
    env = gymnasium.make(task, **names["options"])
    assert env.reset(seed=0)[0] in env.observation_space
    env.close()


def row_of(name: str) -> str:
    """A class, function or module in the table of the Python interface."""
    found = resolve_name(name)
    doc = (inspect.getdoc(found) or "").split("\n")[0]
    parts = [part for part in parts_of(found) if not part.startswith("_")]
    return f"| `{name}` | {', '.join(f'`{part}`' for part in parts)} | {doc} |"


def parts_of(found: Any) -> list[str]:
    """Parameters of a function; fields or parameters, methods and properties of a class; content of others."""
    if inspect.ismodule(found):
        return [name for name, each in vars(found).items() if getattr(each, "__module__", "") == found.__name__]
    if not isinstance(found, type):
        return list(inspect.signature(found).parameters)
    if issubclass(found, Enum):
        return [str(member.name) for member in found]
    is_protocol = getattr(found, "_is_protocol", False)
    parameters = vars(found).get("__annotations__", {}) if is_protocol else inspect.signature(found).parameters
    bases = [base for base in found.__mro__ if base.__module__.startswith(("voxdepth.", "sim."))]
    members = {name: each for base in reversed(bases) for name, each in vars(base).items() if name not in parameters}
    return [
        *parameters,
        *(
            f"{name}{'' if isinstance(each, property) else '()'}"
            for name, each in members.items()
            if isinstance(each, property | classmethod) or inspect.isfunction(each)
        ),
    ]


def test_the_python_interface_is_readable_without_a_build() -> None:
    page = (ROOT / "docs" / "api.md").read_text()
    rows = [row_of(name) for name in MADE_OF.findall(page)]
    assert len(rows) >= 20
    missing = [row for row in rows if row not in page.splitlines()]
    assert not missing, "put these into docs/api.md:\n" + "\n".join(missing)
