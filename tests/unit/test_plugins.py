"""Controllers and correctors of users: found beside them, checked, and part of what a result depends on."""

import os
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenarios.errors import ScenarioError
from scenarios.study.design import expand
from scenarios.study.executors import Serial, run_one
from scenarios.study.run import run_study
from swarm.config import MissionConfig
from swarm.controllers import Role, load_controller
from tests.studies import arm, fake, study, unseen
from tests.swarm_scenes import AIRFRAME
from voxdepth import Frame, Intrinsics, create_corrector
from voxdepth.errors import PluginError
from voxdepth.plugins import digest_of
from voxdepth.registry import latency_s

CAMERA = Intrinsics(width_px=24, height_px=16, fx_px=20, fy_px=20, cx_px=12, cy_px=8, baseline_m=0.1)
CORRECTOR = """from dataclasses import replace
import numpy as np
from voxdepth import CorrectedDepth, DepthCorrector

class Mine(DepthCorrector):
    latency_s = 0.004
    def __init__(self, intrinsics): ...
    def process(self, frame):
        good = CorrectedDepth.of(frame, frame.depth_m.copy())
        return {result}
"""
CONTROLLER = """import numpy as np
from sim.types import VelocityCommand
from swarm.pilot import Decision

class Mine:
    def __init__(self, role, config): ...
    def decide(self, situation):
        return {result}
"""
COMMAND = "Decision(command=VelocityCommand(velocity_m_s={velocity}, yaw_rad={yaw}), state='free')"
HOVER = COMMAND.format(velocity="np.zeros(3)", yaw="0.0")

Write = Callable[[str], str]


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Write:
    """Writes a module of an own name into the current folder and returns its name."""
    name = f"mine_{abs(hash(request.node.nodeid))}"
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)

    def write(text: str) -> str:
        (tmp_path / f"{name}.py").write_text(text)
        return name

    return write


def frame(stamp_s: float = 0.0) -> Frame:
    return Frame(stamp_s=stamp_s, gray=np.zeros(CAMERA.shape, np.uint8), depth_m=np.ones(CAMERA.shape, np.float32))


def agent_of(name: str) -> Any:
    config = MissionConfig(drones=1)
    (team,) = config.teams()
    return load_controller(name)(Role(drone=0, team=team, airframe=AIRFRAME, camera=CAMERA), config)


def test_a_corrector_beside_the_user_is_used_by_its_name(module: Write) -> None:
    name = f"{module(CORRECTOR.replace('(DepthCorrector)', '').format(result='good'))}:Mine"
    corrector = create_corrector(name, CAMERA)
    assert corrector.uses_gray, "unless it says that it does not"
    assert (corrector.process(frame()).depth_m == 1).all()
    corrector.reset()
    assert latency_s(name) == 0.004


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x = 1\n1 / 0\n", "line 2: ZeroDivisionError: division by zero"),
        ("import no_such_module_of_mine\n", "line 1: ModuleNotFoundError: No module named 'no_such_module_of_mine'"),
        ("def Mine(:\n", "line 1: SyntaxError"),
        ("exit(3)\n", "line 1: SystemExit: 3"),
        ("mine = 3\n", "has no attribute 'Mine'"),
        ("Mine = 3\n", "got 3"),
    ],
)
@pytest.mark.parametrize("load", [lambda name: create_corrector(name, CAMERA), load_controller])
def test_what_cannot_be_loaded_is_reported_with_its_line(load: Any, text: str, message: str, module: Write) -> None:
    name = module(text)
    with pytest.raises(PluginError, match=r"factory\((intrinsics|role, config)\)") as error:
        load(f"{name}:Mine")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ("None", "expected a CorrectedDepth, got NoneType"),
        ("replace(good, confidence=good.confidence * 2)", "expected confidence in 0..1"),
        ("good if frame.nothing else None", "line 10: AttributeError"),
        ("exit()", "line 10: SystemExit"),
    ],
)
def test_a_faulty_corrector_is_reported_with_its_file(result: str, message: str, module: Write, tmp_path: Path) -> None:
    name = module(CORRECTOR.format(result=result))
    with pytest.raises(PluginError, match=r"for a frame at 2\.5 s") as error:
        create_corrector(f"{name}:Mine", CAMERA).process(frame(2.5))
    assert str(error.value).startswith(f"the corrector '{name}:Mine' ({tmp_path / name}.py) ")
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("factory", "message"),
    [
        ("def Mine(intrinsics): return None", "returns a DepthCorrector, got NoneType without process"),
        ("def Mine(): return None", "0 positional arguments but 1 was given; expected a factory(intrinsics) that"),
        ("class Mine: pass", "TypeError: Mine() takes no arguments; expected a factory(intrinsics) that returns a"),
        ("def Mine(intrinsics): raise OSError('no licence')", "failed when it is made: line 1: OSError: no licence"),
    ],
)
def test_a_factory_that_makes_no_corrector_is_reported_with_its_file(factory: str, message: str, module: Write) -> None:
    name = module(factory)
    with pytest.raises(PluginError, match=f"{name}.py") as error:
        create_corrector(f"{name}:Mine", CAMERA)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("result", "message"),
    [
        ("None", "expected a Decision with a VelocityCommand, got NoneType"),
        ("Decision(command=np.zeros(3), state='free')", "expected a Decision with a VelocityCommand, got ndarray"),
        (
            COMMAND.format(velocity="np.full(3, np.nan)", yaw="0.0"),
            "expected velocity_m_s as an array of finite numbers",
        ),
        (COMMAND.format(velocity="np.zeros(3)", yaw="'north'"), "expected yaw_rad as finite numbers of shape (), got"),
        ("1 / 0", "line 8: ZeroDivisionError"),
    ],
)
def test_a_faulty_controller_is_reported_with_its_file(
    result: str, message: str, module: Write, tmp_path: Path
) -> None:
    name = module(CONTROLLER.format(result=result))
    with pytest.raises(PluginError, match=r"for drone 0 at 1\.50 s") as error:
        agent_of(f"{name}:Mine").decide(SimpleNamespace(time_s=1.5))
    assert str(error.value).startswith(f"the controller '{name}:Mine' ({tmp_path / name}.py) ")
    assert message in str(error.value)


def flown_by(**changes: Any) -> Any:
    """A study with the user's code in one of its arms."""
    return study(arm("ours"), arm("theirs", **changes))


@pytest.mark.parametrize("kind", ["controller", "corrector", "package"])
def test_a_study_is_not_continued_after_an_edit_of_the_code_that_it_flies(
    kind: str, module: Write, tmp_path: Path
) -> None:
    text = {"controller": CONTROLLER.format(result=HOVER)}.get(kind, CORRECTOR.format(result="good"))
    name, edited = module(text), tmp_path / "edited.py"
    if kind == "package":
        for path in (tmp_path / f"{name}_all" / "__init__.py", tmp_path / f"{name}_all" / "core.py"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text)
        name, edited = f"{name}_all.core", tmp_path / f"{name}_all" / "__init__.py"
    else:
        edited = tmp_path / f"{name}.py"
    own = {"changes": {"mission.controller": f"{name}:Mine"}} if kind == "controller" else {"corrector": f"{name}:Mine"}
    planned = flown_by(**own)
    before = [spec.key for spec in expand(planned)]
    run_study(planned, tmp_path / "out", Serial(fake), unseen)
    run_study(planned, tmp_path / "out", Serial(fake), unseen, resume=True)
    edited.write_text(text + "\n# another version\n")
    changed = [old != spec.key for old, spec in zip(before, expand(planned), strict=True)]
    assert changed == [spec.arm == "theirs" for spec in expand(planned)]
    with pytest.raises(ScenarioError, match=rf"flown with another {name}:Mine, .*another --out"):
        run_study(planned, tmp_path / "out", Serial(fake), unseen, resume=True)
    edited.write_text(text)
    run_study(planned, tmp_path / "out", Serial(fake), unseen, resume=True)


def test_an_edit_while_the_study_flies_ends_its_runs(module: Write, tmp_path: Path) -> None:
    name = module(CONTROLLER.format(result=HOVER))
    spec = expand(flown_by(changes={"mission.controller": f"{name}:Mine"}))[1]
    module(CONTROLLER.format(result=HOVER) + "\n")
    with pytest.raises(ScenarioError, match="has changed since the study began"):
        run_one(spec)


def test_code_that_is_not_there_is_refused_before_anything_flies(module: Write) -> None:
    for own in ({"changes": {"mission.controller": "no_such_mine:create"}}, {"corrector": "no_such_mine:create"}):
        with pytest.raises((ScenarioError, ValueError), match="no_such_mine"):
            expand(flown_by(**own))


@pytest.mark.parametrize("statement", ["import gains", "from gains import GAIN", "import gains as g", "import other"])
def test_the_digest_of_a_module_covers_those_beside_it_that_it_imports(tmp_path: Path, statement: str) -> None:
    file = tmp_path / "mine.py"
    file.write_text(f"{statement}\n")
    (tmp_path / "other.py").write_text("import gains\nimport mine\n")
    for name in ("gains", "apart"):
        (tmp_path / f"{name}.py").write_text("GAIN = 3.0\n")
    before = digest_of(file)
    (tmp_path / "apart.py").write_text("GAIN = 0.1\n")
    assert digest_of(file) == before
    (tmp_path / "gains.py").write_text("GAIN = 0.1\n")
    assert digest_of(file) != before


def test_the_digest_of_a_package_covers_a_module_whose_name_is_no_text(tmp_path: Path) -> None:
    (tmp_path / "__init__.py").touch()
    before = digest_of(tmp_path / "mine.py")
    (tmp_path / os.fsdecode(b"caf\xe9.py")).touch()
    assert digest_of(tmp_path / "mine.py") != before


@pytest.mark.parametrize("name", ["rerun", "types", "cv2", "os", "scipy"])
def test_a_script_named_like_a_package_is_not_imported_in_its_place_and_that_is_reported(
    name: str, module: Write, tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry != str(tmp_path)])
    (tmp_path / f"{name}.py").write_text("raise SystemExit('the script of the user ran')\n")
    mine = module(f"import {name}\n{CORRECTOR.format(result='good')}")
    create_corrector(f"{mine}:Mine", CAMERA)
    found = find_spec(name)
    assert found is not None and found.origin != str(tmp_path / f"{name}.py")
    assert sys.path[-1] == str(tmp_path)
    (message,) = [record.getMessage() for record in caplog.records]
    assert message.startswith(f"{mine}.py imports ")
    assert message.endswith(f"not {name}.py, which has the same name")


@pytest.mark.parametrize("name", ["json", "numba", "time"])
def test_a_module_that_has_the_name_of_another_one_is_refused(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    (tmp_path / f"{name}.py").write_text(CORRECTOR.format(result="good"))
    with pytest.raises(PluginError, match=rf"'{name}:Mine' could be .*{name}\.py or .*{name}.*: rename yours"):
        create_corrector(f"{name}:Mine", CAMERA)


def test_the_digest_of_a_module_leaves_out_a_script_that_it_does_not_import(tmp_path: Path) -> None:
    file, script = tmp_path / "mine.py", tmp_path / "numpy.py"
    file.write_text("import numpy\n")
    before = digest_of(file)
    script.write_text("this is (no Python\n")
    assert digest_of(file) == before
