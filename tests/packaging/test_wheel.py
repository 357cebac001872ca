"""The wheel of the library, installed into clean environments of the oldest and the newest Python that it supports."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.commands import in_new_process
from tests.environments import interpreter, new_environment

ROOT = Path(__file__).parents[2]
PYTHONS = ("3.11", "3.13")
NEED_EXTRA = ("learned",)
"""Correctors that the wheel alone does not run."""
COMMANDS = (("config",), ("doctor",), ("bench", "--size", "160x120"), ("correct", "sample", "--frames", "2"))
RESULTS = """
import hashlib, json
from voxdepth.registry import create_corrector, installed_names
from voxdepth.tools.benchmark import walk
from voxdepth.types import Intrinsics
camera = Intrinsics.from_hfov(width_px=128, height_px=96, hfov_deg=86, baseline_m=0.095)
frames, found = list(walk(4, camera)), {}
for name in installed_names():
    corrector, digest = create_corrector(name, camera), hashlib.sha256()
    for frame in frames:
        result = corrector.process(frame)
        for image in (result.depth_m, result.source, result.confidence):
            digest.update(image.tobytes())
    found[name] = digest.hexdigest()
print(json.dumps(found))
"""
"""A program that prints a digest of what every corrector makes of some drawn frames."""


def digests(python: str | Path) -> dict[str, str]:
    """What `RESULTS` prints."""
    done = subprocess.run([python, "-c", RESULTS], capture_output=True, text=True, check=True, cwd=Path(python).parent)
    found: dict[str, str] = json.loads(done.stdout.splitlines()[-1])
    return found


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    out = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(ROOT)]
    subprocess.run(command, check=True)
    (found,) = out.glob("*.whl")
    return found


@pytest.fixture(scope="module", params=PYTHONS)
def environment(request: pytest.FixtureRequest, wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` of a new environment with the wheel and nothing else."""
    python = interpreter(request.param)
    if python is None:
        pytest.skip(f"there is no Python {request.param} here")
    folder = tmp_path_factory.mktemp("environment")
    return new_environment(folder, python, "--constraint", ROOT / "constraints.txt", wheel).parent


@pytest.mark.slow
def test_the_library_is_complete_without_the_testbed(environment: Path) -> None:
    version = subprocess.run([environment / "voxdepth", "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.startswith("voxdepth ")
    refused = {("evaluate", "sim-LN"): "voxdepth[evaluate]", ("view", "x.rrd"): "no recording at"}
    *done, evaluate, view = in_new_process([*COMMANDS, *refused], python=environment / "python", cwd=environment)
    assert [found for found in done if found.returncode] == []
    for found, words in zip((evaluate, view), refused.values(), strict=True):
        assert found.returncode == 2
        assert words in found.stderr
    here = digests(sys.executable)  # with the extras of development
    assert digests(environment / "python") == {name: here[name] for name in here if name not in NEED_EXTRA}
